// Makes the OpenVDB files in tests/data/volumes with OpenVDB itself, so that another writer than our reader's library has
// written them. Debian: libopenvdb-dev (10.0).
//
// With a second folder it also makes cloud.vdb there: a bank of mist for scenes/small (docs/spray.md).
//
//     g++ -std=c++17 -O1 scripts/make-volumes.cpp -lopenvdb -ltbb -lImath -o make-volumes && ./make-volumes tests/data/volumes
#include <cmath>
#include <limits>
#include <openvdb/openvdb.h>
#include <string>

using namespace openvdb;

// A Gaussian ball: 12 at its middle, a deviation of 2 voxels, cut off at 7.
FloatGrid::Ptr ball(const Coord& middle) {
    auto grid = FloatGrid::create(0.0f);
    grid->setName("density");
    auto at = grid->getAccessor();
    for (int x = -7; x <= 7; ++x)
        for (int y = -7; y <= 7; ++y)
            for (int z = -7; z <= 7; ++z) {
                const int squared = x * x + y * y + z * z;
                if (squared <= 49) at.setValue(middle.offsetBy(x, y, z), 12.0f * std::exp(-squared / 8.0f));
            }
    return grid;
}

// A block of one value.
template <class Grid> typename Grid::Ptr block(const char* name, typename Grid::ValueType value, const CoordBBox& box) {
    auto grid = Grid::create();
    grid->setName(name);
    grid->fill(box, value);
    return grid;
}

void write(const std::string& path, const GridPtrVec& grids, uint32_t compression) {
    io::File file(path);
    file.setCompression(compression);
    file.write(grids);
}

// A bank of mist, 8 m by 1.6 m by 8 m in voxels of 0.1 m, denser below, torn at its top; it drifts east.
void cloud(const std::string& path, const Vec3d& low) {
    auto density = FloatGrid::create(0.0f);
    density->setName("density");
    density->setGridClass(GRID_FOG_VOLUME);
    density->setSaveFloatAsHalf(true);
    auto at = density->getAccessor();
    for (int x = 0; x < 80; ++x)
        for (int y = 0; y < 16; ++y)
            for (int z = 0; z < 80; ++z) {
                double top = 7.0, size = 4.0;
                for (int octave = 1; octave <= 4; ++octave, size /= 2)
                    top += size * std::sin(x * 0.55 / size + 1.7 * octave + std::cos(z * 0.31 / size)) *
                           std::cos(z * 0.43 / size - octave + std::sin(y * 0.2 / size));
                const double edge = std::min({x, 79 - x, z, 79 - z, 12}) / 12.0;
                const double value = edge * std::max(0.0, 1.0 - y / std::max(top, 1.0));
                if (value > 0.0) at.setValue(Coord(x, y, z), float(value));
            }
    auto placing = math::Transform::createLinearTransform(0.1);
    placing->postTranslate(low);
    density->setTransform(placing);
    auto velocity = block<Vec3SGrid>("velocity", Vec3s(1.5f, 0.0f, 0.0f), CoordBBox(0, 0, 0, 79, 15, 79));
    velocity->setTransform(placing);
    write(path, {density, velocity}, io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK);
}

int main(int count, char** arguments) {
    if (count < 2) return 2;
    initialize();
    if (count > 2) cloud(std::string(arguments[2]) + "/cloud.vdb", Vec3d(20.0, -1.5, -4.0));
    const std::string folder = std::string(arguments[1]) + "/";

    // One ball in four codings: voxels of 0.1 m, the middle at (2.2, 3.2, 4.2) m, which flies at (3, 0, -1) m/s.
    auto density = ball(Coord(12, 12, 12));
    auto placing = math::Transform::createLinearTransform(0.1);
    placing->postTranslate(Vec3d(1.0, 2.0, 3.0));
    density->setTransform(placing);
    auto velocity = block<Vec3SGrid>("vel", Vec3s(3.0f, 0.0f, -1.0f), CoordBBox(0, 0, 0, 23, 23, 23));
    velocity->setTransform(placing);
    // Fog volumes are never zipped: this one says of itself nothing.
    write(folder + "zip.vdb", {density, velocity}, io::COMPRESS_ZIP | io::COMPRESS_ACTIVE_MASK);
    density->setGridClass(GRID_FOG_VOLUME);
    write(folder + "plain.vdb", {density, velocity}, io::COMPRESS_ACTIVE_MASK);
    write(folder + "blosc.vdb", {density, velocity}, io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK);
    density->setSaveFloatAsHalf(true);
    velocity->setSaveFloatAsHalf(true);
    write(folder + "half.vdb", {density, velocity}, io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK);

    // A box of tiles and voxels in doubles, turned by 30 degrees and wider along one axis than along the others.
    auto turned = block<DoubleGrid>("density", 2.0, CoordBBox(-4, 0, 0, 24, 23, 23));
    auto axes = math::Transform::createLinearTransform(1.0);
    axes->postScale(Vec3d(0.1, 0.2, 0.1));
    axes->postRotate(std::acos(-1.0) / 6.0, math::Z_AXIS);
    axes->postTranslate(Vec3d(0.0, 5.0, 0.0));
    turned->setTransform(axes);
    // A tile of 128 voxels a side.
    auto large = block<FloatGrid>("large", 0.01f, CoordBBox(0, 0, 0, 127, 127, 127));
    // What is no mist.
    const CoordBBox few(0, 0, 0, 3, 3, 3);
    auto whole = block<Int32Grid>("count", 3, few);
    auto nan = block<FloatGrid>("nan", 1.0f, few);
    nan->tree().setValue(Coord(1, 2, 3), std::numeric_limits<float>::quiet_NaN());
    auto negative = block<FloatGrid>("negative", 1.0f, few);
    negative->tree().setValue(Coord(3, 2, 1), -0.5f);
    auto filled = FloatGrid::create(1.0f);
    filled->setName("filled");
    auto seen = block<FloatGrid>("seen", 1.0f, few);
    seen->setTransform(math::Transform::createFrustumTransform(BBoxd(Vec3d(0.0), Vec3d(10.0)), 0.5, 2.0, 0.1));
    auto fast = block<Vec3DGrid>("fast", Vec3d(0.0, std::numeric_limits<double>::infinity(), 0.0), few);
    write(folder + "others.vdb", {turned, large, whole, nan, negative, filled, seen, fast},
          io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK);
}
