// The C++ half of the bridge to OpenImageIO's texture system; fits OpenImageIO 2.4 and 3.x.
#include "whitewater/ffi/oiio_texture.hh"

#include <stdexcept>
#include <utility>

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/ustring.h>

#include "whitewater/ffi/oiio_texture.rs.h"

namespace whitewater {

namespace {

std::string plain(rust::Str text) { return std::string(text.data(), text.size()); }

[[noreturn]] void fail(std::string message, const std::string &otherwise) {
    throw std::runtime_error(message.empty() ? otherwise : message);
}

std::shared_ptr<OIIO::TextureSystem> create() {
#if OIIO_VERSION_MAJOR >= 3
    return OIIO::TextureSystem::create(false);
#else
    return std::shared_ptr<OIIO::TextureSystem>(OIIO::TextureSystem::create(false), [](OIIO::TextureSystem *system) {
        if (system) OIIO::TextureSystem::destroy(system, true);
    });
#endif
}

}  // namespace

OiioTextures::OiioTextures(float megabytes) : system_(create()) {
    if (!system_) fail(OIIO::geterror(), "no texture system");
    const bool set = system_->attribute("max_memory_MB", megabytes)
                     // One channel is grey, two are grey and alpha.
                     && system_->attribute("gray_to_rgb", 1)
                     // A file that is read untiled would be kept whole, past the limit.
                     && system_->attribute("autotile", 64) && system_->attribute("automip", 1);
    if (!set) fail(system_->geterror(), "the texture system refuses a setting");
}

OiioTexture::OiioTexture(std::shared_ptr<OiioTextures> textures, const std::string &path, bool repeat_s, bool repeat_t)
    : textures_(std::move(textures)), path_(path) {
    OIIO::TextureSystem &system = textures_->system();
    // The texture system itself keeps a file that it cannot open as one that fails at each lookup.
    std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::open(path);
    if (!input) fail(OIIO::geterror(), "could not open " + path);
    const OIIO::ImageSpec &spec = input->spec();
    if (spec.deep || spec.depth > 1 || spec.nchannels < 1) fail("", "expected a flat image");
    width_ = static_cast<uint32_t>(spec.width);
    height_ = static_cast<uint32_t>(spec.height);
    is_float_ = spec.format == OIIO::TypeHalf || spec.format == OIIO::TypeFloat;
    handle_ = system.get_texture_handle(OIIO::ustring(path));
    if (!handle_ || !system.good(handle_)) fail(system.geterror(), "could not open " + path);
    const auto wrap = [](bool repeat) { return repeat ? OIIO::Tex::Wrap::Periodic : OIIO::Tex::Wrap::Clamp; };
    options_.swrap = static_cast<decltype(options_.swrap)>(wrap(repeat_s));
    options_.twrap = static_cast<decltype(options_.twrap)>(wrap(repeat_t));
    // A cubic overshoots: there would be less light than none beside what is bright.
    options_.interpmode = static_cast<decltype(options_.interpmode)>(OIIO::Tex::InterpMode::Bilinear);
    options_.mipmode = static_cast<decltype(options_.mipmode)>(OIIO::Tex::MipMode::Aniso);
    // Alpha, where there is none.
    options_.fill = 1.0f;
}

void OiioTexture::lookup(const std::array<float, 2> &place, const std::array<float, 4> &spans,
                         std::array<float, 4> &color) const {
    OIIO::TextureSystem &system = textures_->system();
    OIIO::TextureOpt options = options_;
    if (!system.texture(handle_, system.get_perthread_info(), options, place[0], place[1], spans[0], spans[1], spans[2],
                        spans[3], 4, color.data()))
        fail(system.geterror(), "could not look up " + path_);
}

std::shared_ptr<OiioTextures> oiio_textures(float megabytes) { return std::make_shared<OiioTextures>(megabytes); }

std::unique_ptr<OiioTexture> oiio_texture(const std::shared_ptr<OiioTextures> &textures, rust::Str path, bool repeat_s,
                                          bool repeat_t) {
    return std::make_unique<OiioTexture>(textures, plain(path), repeat_s, repeat_t);
}

uint32_t oiio_levels(rust::Str path) {
    const std::string name = plain(path);
    std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::open(name);
    if (!input) fail(OIIO::geterror(), "could not open " + name);
    uint32_t levels = 1;
    while (input->seek_subimage(0, static_cast<int>(levels))) ++levels;
    // The last step has failed, as it must.
    (void)input->geterror();
    return levels;
}

void oiio_make_texture(rust::Str path, uint32_t width, uint32_t height, rust::Slice<const float> pixels) {
    const std::string name = plain(path);
    const OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 4, OIIO::TypeFloat);
    if (pixels.size() != static_cast<std::size_t>(width) * height * 4) fail("", "wrong count of samples");
    OIIO::ImageBuf image(spec);
    if (!image.set_pixels(OIIO::get_roi(spec), OIIO::TypeFloat, pixels.data())) fail(image.geterror(), "no image");
    OIIO::ImageSpec wanted;
    wanted.set_format(OIIO::TypeFloat);
    if (!OIIO::ImageBufAlgo::make_texture(OIIO::ImageBufAlgo::MakeTxTexture, image, name, wanted))
        fail(image.has_error() ? image.geterror() : OIIO::geterror(), "could not make " + name);
}

}  // namespace whitewater
