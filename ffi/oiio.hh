// OpenImageIO as whitewater uses it: a writer of parts row by row, a reader of whole parts. The bridge is oiio.rs.
// Every failure is an exception, which cxx turns into a Rust error.
#pragma once

#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include <OpenImageIO/deepdata.h>
#include <OpenImageIO/imageio.h>

#include "rust/cxx.h"

// Found by cxx in place of its own: it would let whatever is no std::exception end the program.
namespace rust {
namespace behavior {
template <typename Try, typename Fail>
static void trycatch(Try &&attempt, Fail &&fail) noexcept try {
    attempt();
} catch (const std::exception &e) {
    fail(e.what());
} catch (...) {
    fail("an exception without a message");
}
}  // namespace behavior
}  // namespace rust

namespace whitewater {

struct OiioAttribute;
struct OiioPart;
struct OiioDeep;

// Writes the parts of one file in order, each from its first row to its last.
class OiioWriter {
public:
    OiioWriter(const std::string &path, std::vector<OIIO::ImageSpec> specs);
    // Rows of the current part from `first` (0 is its top), pixel by pixel, channels in the part's order.
    void write_rows(uint32_t first, rust::Slice<const float> samples);
    // The next part becomes the current one.
    void next_part();
    // Nothing is sure to be in the file before this has returned.
    void close();

private:
    std::string path_;
    std::vector<OIIO::ImageSpec> specs_;
    std::size_t part_ = 0;
    std::unique_ptr<OIIO::ImageOutput> output_;
};

std::unique_ptr<OiioWriter> oiio_create(rust::Str path, rust::Slice<const OiioPart> parts);

// Reads the parts of one file.
class OiioReader {
public:
    explicit OiioReader(const std::string &path);
    uint32_t parts() const;
    // Windows, channels and attributes; the attributes as text.
    OiioPart describe(uint32_t part) const;
    // All samples of a part, pixel by pixel.
    rust::Vec<float> samples(uint32_t part) const;
    // All samples of a deep file's first part.
    void deep(OIIO::DeepData &into) const;

private:
    OIIO::ImageSpec spec(uint32_t part) const;
    std::unique_ptr<OIIO::ImageInput> input_;
};

std::unique_ptr<OiioReader> oiio_open(rust::Str path);

// A deep scanline file of one part; `counts` has the samples of each pixel, row by row.
void oiio_write_deep(rust::Str path, const OiioPart &part, rust::Slice<const uint32_t> counts,
                     rust::Slice<const float> samples);
OiioDeep oiio_read_deep(rust::Str path);

}  // namespace whitewater
