#include "camber/synth/detail/ray_caster.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/synth/synthesise.h"

namespace camber {
namespace {

SynthTriangle plain_triangle(const TrianglePoints& points) {
  SynthTriangle out;
  out.points = points;
  out.normals.fill(Eigen::Vector3f::UnitZ());
  out.texture.fill(Eigen::Vector2f::Zero());
  return out;
}

SynthMesh random_mesh(int count, std::uint64_t seed) {
  const CounterRandom random(seed);
  SynthMesh mesh;
  mesh.objects.resize(1);
  for (int i = 0; i < count; ++i) {
    TrianglePoints triangle;
    const std::uint64_t at = 12 * static_cast<std::uint64_t>(i);
    for (int k = 0; k < 3; ++k) {
      for (int a = 0; a < 3; ++a) {
        triangle[k][a] =
            random.uniform(at + a, -10.0, 10.0) + random.uniform(at + 3 + 3 * k + a, -3, 3);
      }
    }
    mesh.triangles.push_back(plain_triangle(triangle));
  }
  return mesh;
}

/// Where a ray meets a triangle (Moeller and Trumbore, 1997); infinite if it does not. `margin`:
/// how far inside the nearest edge, in barycentric coordinates.
double meet(const TrianglePoints& t, const Eigen::Vector3d& origin,
            const Eigen::Vector3d& direction, double* margin) {
  const Eigen::Vector3d e1 = t[1] - t[0], e2 = t[2] - t[0];
  const Eigen::Vector3d p = direction.cross(e2), s = origin - t[0], q = s.cross(e1);
  const double inverse = 1.0 / e1.dot(p);
  const double u = s.dot(p) * inverse, v = direction.dot(q) * inverse;
  *margin = std::min({u, v, 1.0 - u - v});
  return *margin >= 0.0 && e2.dot(q) * inverse > 0.0 ? e2.dot(q) * inverse
                                                     : std::numeric_limits<double>::infinity();
}

struct Rays {
  std::vector<Eigen::Vector3d> origins, directions;
};

Rays random_rays(int count) {
  const CounterRandom random(8);
  Rays rays;
  for (int i = 0; i < count; ++i) {
    Eigen::Vector3d origin, direction;
    for (int a = 0; a < 3; ++a) {
      origin[a] = random.uniform(6 * i + a, -8.0, 8.0);
      direction[a] = random.uniform(6 * i + 3 + a, -1.0, 1.0);
    }
    if (i % 10 == 0) direction[i / 10 % 3] = 0.0;  // parallel to a side of the trees' boxes
    rays.origins.push_back(origin);
    rays.directions.push_back(direction);
  }
  return rays;
}

TEST(RayCaster, FindsWhatEveryTriangleAloneWouldSay) {
  const SynthMesh mesh = random_mesh(500, 7);
  const std::size_t ground = 300;
  const RayCaster caster(mesh, ground, {}, 1);
  const int count = 3001;  // not a multiple of a packet
  const Rays rays = random_rays(count);
  std::vector<RayCaster::Hit> hits(count);
  std::vector<std::uint8_t> shaded(count);
  caster.nearest(0, rays.origins.data(), true, rays.directions.data(), count, hits.data());
  caster.shaded(0, rays.origins.data(), rays.directions.data(), count, 1e9, shaded.data());
  int met = 0, compared = 0;
  for (int i = 0; i < count; ++i) {
    double nearest = std::numeric_limits<double>::infinity(), risen = nearest;
    int triangle = -1;
    bool doubtful = false;  // within single precision of an edge
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      double margin = 0.0;
      const double distance =
          meet(mesh.triangles[t].points, rays.origins[i], rays.directions[i], &margin);
      doubtful |= std::abs(margin) < 1e-5;
      if (t >= ground) risen = std::min(risen, distance);
      if (distance < nearest) {
        nearest = distance;
        triangle = static_cast<int>(t);
      }
    }
    if (doubtful) continue;
    ++compared;
    EXPECT_EQ(hits[i].triangle, triangle);
    EXPECT_EQ(hits[i].car, -1);
    EXPECT_EQ(shaded[i] != 0, std::isfinite(risen));
    if (triangle < 0) continue;
    ++met;
    // Single precision, at distances of up to some ten units, over grazing angles.
    EXPECT_NEAR(hits[i].distance, nearest, 1e-4 * (1.0 + nearest));
  }
  EXPECT_GT(compared, 2900);
  EXPECT_GT(met, 1000);
}

TEST(RayCaster, EmptySceneMeetsNothing) {
  const RayCaster caster(SynthMesh(), 0, {}, 1);
  const Eigen::Vector3d origin(0, 0, 0), direction(0, 0, 1);
  RayCaster::Hit hit;
  caster.nearest(0, &origin, false, &direction, 1, &hit);
  EXPECT_EQ(hit.triangle, -1);
  std::uint8_t shaded = 1;
  caster.shaded(0, &origin, &direction, 1, 1e9, &shaded);
  EXPECT_EQ(shaded, 0);
}

TEST(RayCaster, CarsAreMetWhereTheyAreInEachFrame) {
  SynthMesh ground;
  ground.objects.resize(1);
  ground.triangles.push_back(plain_triangle(
      {Eigen::Vector3d(-50, -50, 0), Eigen::Vector3d(50, -50, 0), Eigen::Vector3d(0, 90, 0)}));
  SynthCar car;
  car.mesh.objects.resize(1);
  car.mesh.triangles.push_back(plain_triangle(
      {Eigen::Vector3d(-1, 1, -1), Eigen::Vector3d(1, 1, -1), Eigen::Vector3d(0, 1, 1)}));
  // Vehicle y up is the world's z.
  Eigen::Matrix3d rotation;
  rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  for (int f = 0; f < 2; ++f) {
    car.world_from_vehicle.push_back(SE3(rotation, Eigen::Vector3d(4.0 * f, 0, 0)));
  }
  const RayCaster caster(ground, 1, {car}, 2);
  const Eigen::Vector3d above(4, 0, 5), below(0, 0, -1), under(4, 0, 0.01), up(0, 0, 1);
  for (int f = 0; f < 2; ++f) {
    RayCaster::Hit hit;
    caster.nearest(f, &above, false, &below, 1, &hit);
    EXPECT_EQ(hit.car, f == 1 ? 0 : -1);
    EXPECT_NEAR(hit.distance, f == 1 ? 4.0 : 5.0, 1e-5);
    EXPECT_EQ(caster.meets_car(f, 0, above, below), f == 1);
    std::uint8_t shaded = 0;
    caster.shaded(f, &under, &up, 1, 100.0, &shaded);
    EXPECT_EQ(shaded, f);
  }
}

TEST(RayCaster, SameHitsForAnyNumberOfThreadsAndEveryTreeBuilt) {
  SynthOptions options;
  options.seed = 5;
  const SynthWorld world = make_synth_world(world_options(options));
  const RayCaster again(world.ground_and_things, world.num_ground, world.cars, 5);
  const Eigen::Vector3d origin = world.views[0].world_from_camera.translation();
  const Eigen::Matrix3d rotation = world.views[0].world_from_camera.rotation_matrix();
  const int rows = 120, columns = 300;
  std::vector<WorldHit> one(rows * columns), many(rows * columns);
  std::vector<RayCaster::Hit> raw(rows * columns);
  const auto directions = [&](int row) {
    std::vector<Eigen::Vector3d> out;
    for (int c = 0; c < columns; ++c) {
      out.push_back(rotation * Eigen::Vector3d(0.005 * (c - 150), 0.005 * (row - 50), 1.0));
    }
    return out;
  };
  for (int threads : {1, 5}) {
    parallel_for(rows, threads, [&](std::size_t row) {
      const auto d = directions(static_cast<int>(row));
      cast_rays(world, 0, &origin, false, d.data(), d.size(),
                (threads == 1 ? one : many).data() + row * columns);
    });
  }
  for (int row = 0; row < rows; ++row) {
    const auto d = directions(row);
    again.nearest(0, &origin, false, d.data(), d.size(), raw.data() + row * columns);
  }
  int hit = 0;
  for (std::size_t i = 0; i < one.size(); ++i) {
    ASSERT_EQ(one[i].triangle, many[i].triangle);
    ASSERT_EQ(one[i].distance, many[i].distance);
    ASSERT_EQ(one[i].triangle, raw[i].triangle);
    ASSERT_EQ(one[i].car, raw[i].car);
    hit += one[i].triangle >= 0;
  }
  EXPECT_GT(hit, rows * columns / 3);
}

}  // namespace
}  // namespace camber
