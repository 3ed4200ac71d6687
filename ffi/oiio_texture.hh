// OpenImageIO's texture system as whitewater uses it: filtered lookups of files with mip levels. The bridge is oiio_texture.rs.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include <OpenImageIO/texture.h>

#include "whitewater/ffi/oiio.hh"

namespace whitewater {

// A texture system of its own, with a cache of its own.
class OiioTextures {
public:
    explicit OiioTextures(float megabytes);
    OIIO::TextureSystem &system() const { return *system_; }

private:
    std::shared_ptr<OIIO::TextureSystem> system_;
};

// One file; lookups are safe from any thread.
class OiioTexture {
public:
    OiioTexture(std::shared_ptr<OiioTextures> textures, const std::string &path, bool repeat_s, bool repeat_t);
    uint32_t width() const { return width_; }
    uint32_t height() const { return height_; }
    // Whether its samples are half or float.
    bool is_float() const { return is_float_; }
    // Red, green, blue, alpha about s, t over the footprint of ds/dx, dt/dx, ds/dy, dt/dy.
    void lookup(const std::array<float, 2> &place, const std::array<float, 4> &spans, std::array<float, 4> &color) const;

private:
    std::shared_ptr<OiioTextures> textures_;
    std::string path_;
    OIIO::TextureSystem::TextureHandle *handle_ = nullptr;
    OIIO::TextureOpt options_;
    uint32_t width_ = 0, height_ = 0;
    bool is_float_ = false;
};

std::shared_ptr<OiioTextures> oiio_textures(float megabytes);
std::unique_ptr<OiioTexture> oiio_texture(const std::shared_ptr<OiioTextures> &textures, rust::Str path, bool repeat_s,
                                          bool repeat_t);
// Mip levels of a file's first image.
uint32_t oiio_levels(rust::Str path);
// Writes a texture of float samples with all its mip levels.
void oiio_make_texture(rust::Str path, uint32_t width, uint32_t height, rust::Slice<const float> pixels);

}  // namespace whitewater
