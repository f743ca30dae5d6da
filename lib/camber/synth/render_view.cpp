#include "camber/synth/render_view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/synth/noise.h"
#include "camber/synth/shade.h"
#include "camber/synth/triangle_ids.h"

namespace camber {
namespace {

/// A camera's response: linear up to 0.6, then a soft shoulder; gamma 2.2; grey levels.
float response(float light) {
  if (!(light > 0.0f)) return 0.0f;
  const float bent = light < 0.6f ? light : 0.6f + 0.4f * (1.0f - std::exp(-(light - 0.6f) / 0.4f));
  return 255.0f * std::pow(bent, 1.0f / 2.2f);
}

std::vector<float> gaussian_taps(double sigma_samples) {
  const int reach = std::max(0, static_cast<int>(std::ceil(3.0 * sigma_samples)));
  std::vector<float> taps(2 * reach + 1);
  float sum = 0.0f;
  for (int i = -reach; i <= reach; ++i) {
    const double x = sigma_samples > 0.0 ? i / sigma_samples : 0.0;
    taps[i + reach] = static_cast<float>(std::exp(-0.5 * x * x));
    sum += taps[i + reach];
  }
  for (float& tap : taps) tap /= sum;
  return taps;
}

/// Gain that a camera's automatic exposure chooses for the light of a scene.
double exposure(const SynthWorld& world) {
  const double level = world.light.sky + world.light.sun * std::max(0.0, world.light.to_sun.z());
  return 1.6 / level;
}

}  // namespace

std::vector<std::uint8_t> render_view(const SynthWorld& world, int frame,
                                      const PinholeCamera& camera, const CameraSensor& sensor,
                                      int num_threads) {
  const int k = sensor.supersampling;
  const TriangleIds ids = rasterise_triangle_ids(world, frame, camera, k);
  const int width = ids.width, height = ids.height;

  // Linear light at every sample. Lamps and glints are held at twice white before the lens blurs.
  std::vector<float> light(static_cast<std::size_t>(width) * height * 3);
  const SE3& world_from_camera = world.views[frame].world_from_camera;
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  const Eigen::Vector3d step_x = rotation.col(0) / (camera.fx * k);
  const Eigen::Vector3d step_y = rotation.col(1) / (camera.fy * k);
  parallel_for(height, num_threads, [&](std::size_t y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d pixel((x + 0.5) / k - 0.5, (static_cast<double>(y) + 0.5) / k - 0.5);
      ViewRay ray;
      ray.origin = world_from_camera.translation();
      ray.direction = rotation * camera.ray(pixel);
      ray.along_x = step_x;
      ray.along_y = step_y;
      ray.random = hash_lattice(
          x, static_cast<std::int32_t>(y),
          static_cast<std::uint32_t>(sensor.seed) * 31u + static_cast<std::uint32_t>(frame));
      const std::size_t at = y * width + x;
      const Radiance seen = shade_hit(world, frame, ray, ids.hits[at]);
      for (int c = 0; c < 3; ++c) light[3 * at + c] = std::clamp(seen[c], 0.0f, 2.0f);
    }
  });

  // The pixel's own square and the lens's blur in one separable filter, taken at pixel centres.
  // A box of one pixel has a standard deviation of 0.29 px.
  const double sigma = std::sqrt(sensor.blur * sensor.blur + 1.0 / 12.0) * k;
  const std::vector<float> taps = gaussian_taps(k > 1 || sensor.blur > 0.0 ? sigma : 0.0);
  const int reach = static_cast<int>(taps.size()) / 2;
  const int columns = camera.width;
  // With an even k the pixel's centre lies between two samples: the mean of both filters.
  const auto filtered = [&](int n, int center_twice, const auto& value) {
    float sum = 0.0f;
    const int first = (center_twice) / 2, second = (center_twice + 1) / 2;
    for (int i = -reach; i <= reach; ++i) {
      const int a = std::clamp(first + i, 0, n - 1), b = std::clamp(second + i, 0, n - 1);
      sum += taps[i + reach] * (first == second ? value(a) : 0.5f * (value(a) + value(b)));
    }
    return sum;
  };
  std::vector<float> rows(static_cast<std::size_t>(columns) * height * 3);
  parallel_for(height, num_threads, [&](std::size_t y) {
    for (int u = 0; u < columns; ++u) {
      for (int c = 0; c < 3; ++c) {
        rows[(y * columns + u) * 3 + c] = filtered(
            width, 2 * u * k + k - 1, [&](int x) { return light[(y * width + x) * 3 + c]; });
      }
    }
  });

  const CounterRandom random(sensor.seed, 0x494D4147u + static_cast<std::uint64_t>(frame));
  const auto gain = static_cast<float>(
      exposure(world) * std::exp(sensor.exposure_change * std::clamp(random.normal(0), -2.0, 2.0)));
  std::vector<std::uint8_t> out(static_cast<std::size_t>(columns) * camera.height * 3);
  const double corner = std::hypot(0.5 * camera.width, 0.5 * camera.height);
  parallel_for(camera.height, num_threads, [&](std::size_t v) {
    for (int u = 0; u < columns; ++u) {
      const double away = std::hypot(u - 0.5 * (camera.width - 1),
                                     static_cast<double>(v) - 0.5 * (camera.height - 1)) /
                          corner;
      const auto shading = static_cast<float>(1.0 - sensor.vignetting * away * away);
      for (int c = 0; c < 3; ++c) {
        const float value = filtered(height, 2 * static_cast<int>(v) * k + k - 1, [&](int y) {
          return rows[(static_cast<std::size_t>(y) * columns + u) * 3 + c];
        });
        const std::size_t at = (v * columns + u) * 3 + c;
        const double grey = response(gain * shading * value) + sensor.noise * random.normal(8 + at);
        out[at] = static_cast<std::uint8_t>(std::clamp(std::lround(grey), 0l, 255l));
      }
    }
  });
  return out;
}

ViewTruth trace_view(const SynthWorld& world, int frame, const PinholeCamera& camera,
                     int num_threads) {
  ViewTruth out;
  const std::size_t count = static_cast<std::size_t>(camera.width) * camera.height;
  out.hits.resize(count);
  out.labels.resize(count);
  const SE3& world_from_camera = world.views[frame].world_from_camera;
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  const std::size_t cars = world.cars.size();
  std::vector<int> outline(cars * camera.height, 0), visible(cars * camera.height, 0);
  std::vector<SE3> vehicle_from_world;
  for (const SynthCar& car : world.cars) {
    vehicle_from_world.push_back(car.world_from_vehicle[frame].inverse());
  }
  parallel_for(camera.height, num_threads, [&](std::size_t v) {
    for (int u = 0; u < camera.width; ++u) {
      // The direction's z in the camera is 1, so distances are depths.
      const Eigen::Vector3d direction =
          rotation * camera.ray(Eigen::Vector2d(u, static_cast<double>(v)));
      const Eigen::Vector3d origin = world_from_camera.translation();
      const std::size_t at = v * camera.width + u;
      const WorldHit hit = cast_ray(world, frame, origin, direction);
      out.hits[at] = hit;
      TruthLabel label = TruthLabel::kSky;
      if (hit.triangle >= 0) {
        const SynthMesh& mesh = hit.car < 0 ? world.ground_and_things : world.cars[hit.car].mesh;
        label = mesh.objects[mesh.triangles[hit.triangle].object].label;
      }
      out.labels[at] = static_cast<std::uint8_t>(label);
      for (std::size_t i = 0; i < cars; ++i) {
        if (hit.car == static_cast<int>(i)) {
          ++visible[i * camera.height + v];
          ++outline[i * camera.height + v];
          continue;
        }
        const Eigen::Vector3d away = world.cars[i].world_from_vehicle[frame].translation() - origin;
        if ((away.cross(direction) / direction.norm()).squaredNorm() > 16.0) continue;
        if (world.cars[i].bvh.blocked(vehicle_from_world[i] * origin,
                                      vehicle_from_world[i].rotation() * direction, 0.0, 1e4)) {
          ++outline[i * camera.height + v];
        }
      }
    }
  });
  out.outline_pixels.assign(cars, 0);
  out.visible_pixels.assign(cars, 0);
  for (std::size_t i = 0; i < cars; ++i) {
    for (int v = 0; v < camera.height; ++v) {
      out.outline_pixels[i] += outline[i * camera.height + v];
      out.visible_pixels[i] += visible[i * camera.height + v];
    }
  }
  return out;
}

}  // namespace camber
