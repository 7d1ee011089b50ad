/* vdb_writer FOLDER: files by OpenVDB's own library, for tests/test_vdb.c, which compiles this where the library is
   installed. Beside each NAME.vdb, NAME.truth has what the library says of the grid: the box of active voxels, the
   centres of four voxels, and values of voxels. */

#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <fstream>
#include <string>

using openvdb::Coord;
using openvdb::FloatGrid;

static std::string folder;

template <typename T> static void put(std::ostream &out, T value) {
    out.write(reinterpret_cast<const char *>(&value), sizeof value);
}

/* All voxels of a small box, some of a large one. */
static void write_truth(const FloatGrid &grid, const std::string &name) {
    const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
    std::ofstream out(folder + "/" + name + ".truth", std::ios::binary);
    const Coord size = box.dim();
    for (int a = 0; a < 3; ++a) put(out, int32_t(box.min()[a]));
    for (int a = 0; a < 3; ++a) put(out, int32_t(size[a]));
    for (int i = 0; i < 4; ++i) {
        Coord at = box.min();
        if (i > 0) at[i - 1] += 1;
        const openvdb::Vec3d place = grid.indexToWorld(at);
        for (int a = 0; a < 3; ++a) put(out, place[a]);
    }
    const double all = double(size[0]) * size[1] * size[2];
    const int32_t count = int32_t(all < 100000 ? all : 30000);
    put(out, uint64_t(grid.activeVoxelCount()));
    put(out, count);
    uint32_t seed = 1;
    const FloatGrid::ConstAccessor values = grid.getConstAccessor();
    for (int32_t i = 0; i < count; ++i) {
        Coord at(i % size[0], i / size[0] % size[1], i / size[0] / size[1]);
        for (int a = 0; a < 3 && all >= 100000; ++a) {
            seed = seed * 1664525u + 1013904223u;
            at[a] = int(double(seed) / 4294967296.0 * size[a]);
        }
        for (int a = 0; a < 3; ++a) put(out, int32_t(at[a]));
        put(out, values.getValue(at + box.min()));
    }
}

static void write(const openvdb::GridPtrVec &grids, const std::string &name, uint32_t compression) {
    openvdb::io::File file(folder + "/" + name + ".vdb");
    file.setCompression(compression);
    file.write(grids);
    file.close();
}

/* Values that differ, some of them inactive, at negative coordinates. `kinds` of inactive values: 0: the background, 1:
   another, 2: one or the other, 3: two others, 4: minus the background, 5: that or the background, 6: all differ. */
static FloatGrid::Ptr cloud(int kinds, float background) {
    FloatGrid::Ptr grid = FloatGrid::create(background);
    FloatGrid::Accessor at = grid->getAccessor();
    grid->setName("density");
    for (int i = -21; i < 17; ++i)
        for (int j = -3; j < 12; ++j)
            for (int k = 5; k < 31; ++k) {
                const int n = i * 7 + j * 3 + k;
                const float others[7] = {background,  0.5f, n % 2 ? 0.5f : background, n % 2 ? 0.5f : 0.25f,
                                         -background, n % 2 ? -background : background, 0.001f * float(n)};
                if (n % 3)
                    at.setValue(Coord(i, j, k), 0.01f * float(i) + 0.1f * float(j) + float(k * k % 7));
                else if (kinds > 0)
                    at.setValueOff(Coord(i, j, k), others[kinds]);
            }
    return grid;
}

/* A part of each: voxels, and tiles of 8, 128 and 4096 voxels along an edge. */
static FloatGrid::Ptr tiles() {
    FloatGrid::Ptr grid = cloud(0, 0);
    grid->fill(openvdb::CoordBBox(Coord(64, 0, 0), Coord(64 + 255, 130, 270)), 2.5f);
    grid->fill(openvdb::CoordBBox(Coord(512, 1, 2), Coord(540, 30, 29)), 1.5f, false);
    grid->tree().root().addTile(Coord(4096, -4096, 0), 0.75f, true);
    return grid;
}

static openvdb::math::Transform::Ptr rotated() {
    const openvdb::math::Mat4d m(0.1, 0.2, -0.05, 0.0, -0.2, 0.1, 0.02, 0.0, 0.01, 0.03, 0.3, 0.0, 5.0, -7.0, 11.0,
                                 1.0);
    return openvdb::math::Transform::createLinearTransform(m);
}

static void write_maps() {
    FloatGrid::Ptr grid = cloud(0, 0);
    using openvdb::math::Transform;
    namespace maps = openvdb::math;
    const maps::MapBase::Ptr all[] = {
        maps::MapBase::Ptr(new maps::UniformScaleMap(0.25)),
        maps::MapBase::Ptr(new maps::ScaleMap(openvdb::Vec3d(0.5, -2, 3))),
        maps::MapBase::Ptr(new maps::TranslationMap(openvdb::Vec3d(1, 2, -3.5))),
        maps::MapBase::Ptr(new maps::UniformScaleTranslateMap(0.125, openvdb::Vec3d(1, 2, -3.5))),
        maps::MapBase::Ptr(new maps::ScaleTranslateMap(openvdb::Vec3d(0.5, 2, 3), openvdb::Vec3d(-1, 2, 3.5))),
        maps::MapBase::Ptr(new maps::UnitaryMap(openvdb::Vec3d(1, 2, 3), 0.7))};
    for (int i = 0; i < 6; ++i) {
        grid->setTransform(Transform::Ptr(new Transform(all[i])));
        write({grid}, "map" + std::to_string(i), 6);
        write_truth(*grid, "map" + std::to_string(i));
    }
    grid->setTransform(rotated());
    write({grid}, "map6", 6);
    write_truth(*grid, "map6");
}

int main(int count, char **arguments) {
    if (count < 2) return 1;
    folder = arguments[1];
    openvdb::initialize();
    for (uint32_t compression = 0; compression < 8; ++compression)
        for (int kinds = 0; kinds < 7; ++kinds)
            for (int half = 0; half < 2; ++half) {
                const std::string name = std::string(half ? "half" : "float") + std::to_string(compression) + "_" +
                                         std::to_string(kinds);
                FloatGrid::Ptr grid = cloud(kinds, kinds == 0 ? 0.0f : 0.125f);
                grid->setSaveFloatAsHalf(half != 0);
                write({grid}, name, compression);
                openvdb::io::File file(folder + "/" + name + ".vdb"); /* as it is after rounding */
                file.open();
                write_truth(*openvdb::gridPtrCast<FloatGrid>(file.readGrid("density")), name);
            }
    const FloatGrid::Ptr many = tiles();
    write({many}, "tiles", 6);
    write_truth(*many, "tiles");
    write_maps();
    FloatGrid::Ptr ball = openvdb::tools::createLevelSetSphere<FloatGrid>(9, openvdb::Vec3f(1, 2, 3), 0.5f);
    ball->setName("ball");
    write({ball}, "ball", 6);
    write_truth(*ball, "ball");
    FloatGrid::Ptr shared = openvdb::gridPtrCast<FloatGrid>(many->copyGrid()); /* it has the same tree */
    shared->setName("shared");
    shared->setTransform(rotated());
    openvdb::Vec3SGrid::Ptr wind = openvdb::Vec3SGrid::create();
    wind->setName("wind");
    FloatGrid::Ptr second = cloud(1, 0);
    write({wind, many, shared, second}, "several", 6);
    write_truth(*shared, "several");
    return 0;
}
