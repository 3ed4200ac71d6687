// The C++ half of the OpenImageIO bridge; fits OpenImageIO 2.4 and 3.x.
#include "whitewater/ffi/oiio.hh"

#include <cstdlib>
#include <stdexcept>
#include <utility>
#include <vector>

#include <OpenImageIO/strutil.h>
#include <OpenImageIO/ustring.h>

#include "whitewater/ffi/oiio.rs.h"

namespace whitewater {

namespace {

std::string plain(rust::Str text) { return std::string(text.data(), text.size()); }
std::string plain(const rust::String &text) { return std::string(text.data(), text.size()); }

[[noreturn]] void fail(std::string message, const std::string &otherwise) {
    throw std::runtime_error(message.empty() ? otherwise : message);
}

void put(OIIO::ImageSpec &spec, const OiioAttribute &attribute) {
    const std::string name = plain(attribute.name);
    // The lengths are checked here, since OpenImageIO copies as many values as the type says.
    const auto floats = [&](OIIO::TypeDesc type, std::size_t count) {
        if (attribute.floats.size() != count) fail("", name + ": wrong count of values");
        spec.attribute(name, type, attribute.floats.data());
    };
    const auto integers = [&](OIIO::TypeDesc type, std::size_t count) {
        if (attribute.integers.size() != count) fail("", name + ": wrong count of values");
        spec.attribute(name, type, attribute.integers.data());
    };
    switch (attribute.kind) {
    case OiioKind::Text: spec.attribute(name, plain(attribute.text)); return;
    case OiioKind::Texts: {
        std::vector<OIIO::ustring> lines;
        for (const std::string &line : OIIO::Strutil::splits(plain(attribute.text), "\n")) lines.emplace_back(line);
        spec.attribute(name, OIIO::TypeDesc(OIIO::TypeDesc::STRING, static_cast<int>(lines.size())), lines.data());
        return;
    }
    case OiioKind::Integer: return integers(OIIO::TypeInt, 1);
    case OiioKind::Rational: return integers(OIIO::TypeRational, 2);
    case OiioKind::TimeCode: return integers(OIIO::TypeTimeCode, 2);
    case OiioKind::Float: return floats(OIIO::TypeFloat, 1);
    case OiioKind::Vector2:
        return floats(OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, OIIO::TypeDesc::VEC2), 2);
    case OiioKind::Matrix: return floats(OIIO::TypeMatrix, 16);
    case OiioKind::Chromaticities: return floats(OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), 8);
    case OiioKind::Suppressed: {
        // OpenImageIO adds a date where it finds none, and writes none where it finds one of a type that a date
        // cannot have. There is no setting for it.
        const float nothing[3] = {0, 0, 0};
        spec.attribute(name, OIIO::TypeVector, nothing);
        return;
    }
    default: fail("", name + ": unknown kind of attribute");
    }
}

OIIO::ImageSpec make_spec(const OiioPart &part) {
    OIIO::ImageSpec spec(static_cast<int>(part.width), static_cast<int>(part.height),
                         static_cast<int>(part.channels.size()), OIIO::TypeHalf);
    spec.x = part.x;
    spec.y = part.y;
    spec.full_x = 0;
    spec.full_y = 0;
    spec.full_width = static_cast<int>(part.display_width);
    spec.full_height = static_cast<int>(part.display_height);
    bool any_float = false, any_half = false;
    spec.channelnames.clear();
    for (std::size_t c = 0; c < part.channels.size(); ++c) {
        const OiioChannel &channel = part.channels[c];
        spec.channelnames.push_back(plain(channel.name));
        spec.channelformats.push_back(channel.half ? OIIO::TypeHalf : OIIO::TypeFloat);
        (channel.half ? any_half : any_float) = true;
        if (channel.name == "A") spec.alpha_channel = static_cast<int>(c);
        if (channel.name == "Z") spec.z_channel = static_cast<int>(c);
    }
    if (any_float) spec.format = OIIO::TypeFloat;
    // One format for all when they agree: otherwise OpenImageIO 3 takes half for float.
    if (!(any_float && any_half)) spec.channelformats.clear();
    if (!part.name.empty()) spec.attribute("oiio:subimagename", plain(part.name));
    if (!part.compression.empty()) spec.attribute("compression", plain(part.compression));
    for (const OiioAttribute &attribute : part.attributes) put(spec, attribute);
    return spec;
}

}  // namespace

OiioWriter::OiioWriter(const std::string &path, std::vector<OIIO::ImageSpec> specs)
    : path_(path), specs_(std::move(specs)), output_(OIIO::ImageOutput::create(path)) {
    if (!output_) fail(OIIO::geterror(), "no format for " + path);
    if (specs_.empty()) fail("", "no parts");
    for (OIIO::ImageSpec &spec : specs_) {
        // Formats without a type per channel get the widest for all.
        if (!output_->supports("channelformats")) spec.channelformats.clear();
    }
    const bool opened = specs_.size() == 1
                            ? output_->open(path, specs_[0])
                            : output_->open(path, static_cast<int>(specs_.size()), specs_.data());
    if (!opened) fail(output_->geterror(), "could not open " + path);
}

void OiioWriter::write_rows(uint32_t first, rust::Slice<const float> samples) {
    const OIIO::ImageSpec &spec = specs_[part_];
    const std::size_t row = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.nchannels);
    const std::size_t rows = samples.size() / row;
    if (rows * row != samples.size() || first + rows > static_cast<std::size_t>(spec.height))
        fail("", "rows beyond the picture");
    const int top = spec.y + static_cast<int>(first);
    if (!output_->write_scanlines(top, top + static_cast<int>(rows), 0, OIIO::TypeFloat, samples.data()))
        fail(output_->geterror(), "could not write " + path_);
}

void OiioWriter::next_part() {
    if (part_ + 1 >= specs_.size()) fail("", "no further part");
    ++part_;
    if (!output_->open(path_, specs_[part_], OIIO::ImageOutput::AppendSubimage))
        fail(output_->geterror(), "could not begin the next part of " + path_);
}

void OiioWriter::close() {
    if (!output_->close()) fail(output_->geterror(), "could not finish " + path_);
    output_.reset();
}

std::unique_ptr<OiioWriter> oiio_create(rust::Str path, rust::Slice<const OiioPart> parts) {
    // Debian's build reports the suppressed date on the terminal unless told not to.
    if (std::getenv("OPENIMAGEIO_DEBUG") == nullptr) OIIO::attribute("debug", 0);
    std::vector<OIIO::ImageSpec> specs;
    for (const OiioPart &part : parts) specs.push_back(make_spec(part));
    return std::make_unique<OiioWriter>(plain(path), std::move(specs));
}

OiioReader::OiioReader(const std::string &path) : input_(OIIO::ImageInput::open(path)) {
    if (!input_) fail(OIIO::geterror(), "could not open " + path);
}

OIIO::ImageSpec OiioReader::spec(uint32_t part) const {
    OIIO::ImageSpec spec = input_->spec(static_cast<int>(part));
    if (spec.width == 0) fail(input_->geterror(), "no such part");
    return spec;
}

uint32_t OiioReader::parts() const {
    uint32_t count = 0;
    while (input_->seek_subimage(static_cast<int>(count), 0)) ++count;
    // The question that found the end counts as an error; it is none.
    (void)input_->geterror();
    return count;
}

OiioPart OiioReader::describe(uint32_t part) const {
    const OIIO::ImageSpec found = spec(part);
    OiioPart result;
    result.x = found.x;
    result.y = found.y;
    result.width = static_cast<uint32_t>(found.width);
    result.height = static_cast<uint32_t>(found.height);
    result.display_width = static_cast<uint32_t>(found.full_width);
    result.display_height = static_cast<uint32_t>(found.full_height);
    for (int c = 0; c < found.nchannels; ++c) {
        OiioChannel channel;
        channel.name = rust::String::lossy(found.channel_name(c).data(), found.channel_name(c).size());
        channel.half = found.channelformat(c) == OIIO::TypeHalf;
        result.channels.push_back(std::move(channel));
    }
    for (const OIIO::ParamValue &value : found.extra_attribs) {
        const std::string text = value.type() == OIIO::TypeString ? value.get_string()
                                                                  : OIIO::ImageSpec::metadata_val(value, false);
        OiioAttribute attribute;
        attribute.name = rust::String::lossy(value.name().string());
        attribute.kind = OiioKind::Text;
        attribute.text = rust::String::lossy(text);
        if (attribute.name == "oiio:subimagename") result.name = attribute.text;
        if (attribute.name == "compression") result.compression = attribute.text;
        result.attributes.push_back(std::move(attribute));
    }
    return result;
}

rust::Vec<float> OiioReader::samples(uint32_t part) const {
    const OIIO::ImageSpec found = spec(part);
    std::vector<float> samples(static_cast<std::size_t>(found.width) * static_cast<std::size_t>(found.height) *
                               static_cast<std::size_t>(found.nchannels));
    if (!input_->read_image(static_cast<int>(part), 0, 0, found.nchannels, OIIO::TypeFloat, samples.data()))
        fail(input_->geterror(), "could not read the samples");
    rust::Vec<float> result;
    result.reserve(samples.size());
    for (const float sample : samples) result.push_back(sample);
    return result;
}

void OiioReader::deep(OIIO::DeepData &into) const {
    if (!spec(0).deep) fail("", "no deep samples");
    if (!input_->read_native_deep_image(0, 0, into)) fail(input_->geterror(), "could not read the deep samples");
}

std::unique_ptr<OiioReader> oiio_open(rust::Str path) { return std::make_unique<OiioReader>(plain(path)); }

void oiio_write_deep(rust::Str path, const OiioPart &part, rust::Slice<const uint32_t> counts,
                     rust::Slice<const float> samples) {
    if (std::getenv("OPENIMAGEIO_DEBUG") == nullptr) OIIO::attribute("debug", 0);
    OIIO::ImageSpec spec = make_spec(part);
    spec.deep = true;
    const std::size_t pixels = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height);
    const std::size_t channels = static_cast<std::size_t>(spec.nchannels);
    std::size_t total = 0;
    for (const uint32_t count : counts) total += count;
    if (counts.size() != pixels || samples.size() != total * channels) fail("", "wrong count of deep samples");
    const std::string name = plain(path);
    std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(name);
    if (!output) fail(OIIO::geterror(), "no format for " + name);
    if (!output->open(name, spec)) fail(output->geterror(), "could not open " + name);
    // A row at a time: OpenImageIO's own copy of all samples would double the memory.
    std::size_t next = 0;
    OIIO::ImageSpec row = spec;
    row.height = 1;
    for (int y = 0; y < spec.height; ++y) {
        OIIO::DeepData deep(row);
        const std::size_t first = static_cast<std::size_t>(y) * static_cast<std::size_t>(spec.width);
        for (int x = 0; x < spec.width; ++x)
            deep.set_samples(x, static_cast<int>(counts[first + static_cast<std::size_t>(x)]));
        for (int x = 0; x < spec.width; ++x)
            for (int s = 0; s < deep.samples(x); ++s)
                for (int c = 0; c < spec.nchannels; ++c) deep.set_deep_value(x, c, s, samples[next++]);
        if (!output->write_deep_scanlines(spec.y + y, spec.y + y + 1, 0, deep))
            fail(output->geterror(), "could not write " + name);
    }
    if (!output->close()) fail(output->geterror(), "could not finish " + name);
}

OiioDeep oiio_read_deep(rust::Str path) {
    const OiioReader reader(plain(path));
    OiioDeep result;
    result.part = reader.describe(0);
    OIIO::DeepData deep;
    reader.deep(deep);
    for (int64_t pixel = 0; pixel < deep.pixels(); ++pixel) {
        const int count = deep.samples(pixel);
        result.counts.push_back(static_cast<uint32_t>(count));
        for (int s = 0; s < count; ++s)
            for (int c = 0; c < deep.channels(); ++c) result.samples.push_back(deep.deep_value(pixel, c, s));
    }
    return result;
}

}  // namespace whitewater
