#include "camber/synth/render_view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/core/random.h"
#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/ray_caster.h"
#include "camber/synth/detail/shade.h"

namespace camber {
namespace {

/// A camera's response: linear up to 0.6, then a soft shoulder; gamma 2.2; grey levels.
float response(float light) {
  if (!(light > 0.0f)) return 0.0f;
  const float bent = light < 0.6f ? light : 0.6f + 0.4f * (1.0f - std::exp(-(light - 0.6f) / 0.4f));
  return 255.0f * std::pow(bent, 1.0f / 2.2f);
}

/// From samples to pixels along one axis: weights of the samples from pixel * k + first on.
struct PixelFilter {
  int k = 1, first = 0;
  std::vector<float> weights;
};

/// The pixel's own square and the lens's blur in one, at the pixel's centre. A box of one pixel has
/// a standard deviation of 0.29 px. With an even number of samples the centre lies between two: the
/// mean of a filter at either.
PixelFilter make_filter(int k, double blur) {
  const double sigma = k > 1 || blur > 0.0 ? std::sqrt(blur * blur + 1.0 / 12.0) * k : 0.0;
  const int reach = std::max(0, static_cast<int>(std::ceil(3.0 * sigma)));
  std::vector<float> taps(2 * reach + 1);
  float sum = 0.0f;
  for (int i = -reach; i <= reach; ++i) {
    const double x = sigma > 0.0 ? i / sigma : 0.0;
    taps[i + reach] = static_cast<float>(std::exp(-0.5 * x * x));
    sum += taps[i + reach];
  }
  for (float& tap : taps) tap /= sum;
  PixelFilter out{k, (k - 1) / 2 - reach, taps};
  if (k % 2 == 0) {
    out.weights.assign(taps.size() + 1, 0.0f);
    for (std::size_t i = 0; i < taps.size(); ++i) {
      out.weights[i] += 0.5f * taps[i];
      out.weights[i + 1] += 0.5f * taps[i];
    }
  }
  return out;
}

CAMBER_TARGET_CLONES("avx2")
void add_scaled(const float* __restrict in, float factor, std::size_t count,
                float* __restrict out) {
  for (std::size_t i = 0; i < count; ++i) out[i] += factor * in[i];
}

/// A row of samples (width of them) to a row of pixels.
void filter_row(const PixelFilter& filter, const std::vector<Color>& samples, int pixels,
                float* out) {
  const int last = static_cast<int>(samples.size()) - 1;
  const int taps = static_cast<int>(filter.weights.size());
  for (int u = 0; u < pixels; ++u) {
    Color sum = Color::Zero();
    const int first = u * filter.k + filter.first;
    if (first >= 0 && first + taps - 1 <= last) {
      for (int i = 0; i < taps; ++i) sum += filter.weights[i] * samples[first + i];
    } else {
      for (int i = 0; i < taps; ++i) {
        sum += filter.weights[i] * samples[std::clamp(first + i, 0, last)];
      }
    }
    for (int c = 0; c < 3; ++c) out[3 * u + c] = sum[c];
  }
}

/// Gain that a camera's automatic exposure chooses for the light of a scene.
double exposure(const SynthWorld& world) {
  const double level = world.light.sky + world.light.sun * std::max(0.0, world.light.to_sun.z());
  return 1.6 / level;
}

/// How rays change from sample to sample: everywhere the same without a lens, else as at a pixel.
void set_footprint(const ViewCamera& view, const Eigen::Matrix3d& rotation, int k,
                   const Eigen::Vector2d& pixel, SampleRays* rays) {
  if (!view.has_lens()) {
    rays->along_x = rotation.col(0) / (view.file().fx * k);
    rays->along_y = rotation.col(1) / (view.file().fy * k);
    return;
  }
  const Eigen::Vector3d across =
      view.ray(pixel + Eigen::Vector2d(0.5, 0.0)) - view.ray(pixel - Eigen::Vector2d(0.5, 0.0));
  const Eigen::Vector3d down =
      view.ray(pixel + Eigen::Vector2d(0.0, 0.5)) - view.ray(pixel - Eigen::Vector2d(0.0, 0.5));
  // At the model's end there is none: that of the axis.
  rays->along_x =
      rotation * (across.allFinite() ? across : Eigen::Vector3d::UnitX() / view.file().fx) / k;
  rays->along_y =
      rotation * (down.allFinite() ? down : Eigen::Vector3d::UnitY() / view.file().fy) / k;
}

/// Linear light of one row of samples. Lamps and glints are held at twice white before the lens
/// blurs.
void shade_row(const Shader& shader, const SE3& world_from_camera, const ViewCamera& view, int k,
               int y, std::uint32_t seed, std::vector<Color>* light) {
  const int block = view.has_lens() ? 96 : 512;
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  const auto pixel_of = [&](int x) {
    return Eigen::Vector2d((x + 0.5) / k - 0.5, (y + 0.5) / k - 0.5);
  };
  SampleRays rays;
  rays.origins = {world_from_camera.translation()};
  const int width = static_cast<int>(light->size());
  std::vector<int> samples;
  std::vector<Color> seen;
  std::fill(light->begin(), light->end(), Color::Zero());
  for (int begin = 0; begin < width; begin += block) {
    const int end = std::min(width, begin + block);
    rays.directions.clear();
    rays.random.clear();
    samples.clear();
    for (int x = begin; x < end; ++x) {
      const Eigen::Vector3d ray = view.ray(pixel_of(x));
      if (!ray.allFinite()) continue;
      rays.directions.push_back(rotation * ray);
      rays.random.push_back(hash_lattice(x, y, seed));
      samples.push_back(x);
    }
    if (samples.empty()) continue;
    set_footprint(view, rotation, k, pixel_of(samples[samples.size() / 2]), &rays);
    seen.resize(samples.size());
    shader.shade(rays, seen.data());
    for (std::size_t i = 0; i < samples.size(); ++i) (*light)[samples[i]] = seen[i];
  }
  for (Color& color : *light) color = color.cwiseMax(0.0f).cwiseMin(2.0f);
}

}  // namespace

std::vector<std::uint8_t> render_view(const SynthWorld& world, int frame, const ViewCamera& view,
                                      const CameraSensor& sensor, int num_threads) {
  return render_view(world, frame, world.views[frame].world_from_camera, view, sensor, num_threads);
}

std::vector<std::uint8_t> render_view(const SynthWorld& world, int frame,
                                      const SE3& world_from_camera, const ViewCamera& view,
                                      const CameraSensor& sensor, int num_threads) {
  const PinholeCamera& camera = view.file();
  const int k = sensor.supersampling;
  const int height = camera.height * k;
  const std::size_t row = 3 * static_cast<std::size_t>(camera.width);
  const PixelFilter filter = make_filter(k, sensor.blur);
  const Shader shader(world, frame);
  const std::uint32_t seed =
      static_cast<std::uint32_t>(sensor.seed) * 31u + static_cast<std::uint32_t>(frame);
  std::vector<float> rows(row * height);
  parallel_for(height, num_threads, [&](std::size_t y) {
    std::vector<Color> light(static_cast<std::size_t>(camera.width) * k);
    shade_row(shader, world_from_camera, view, k, static_cast<int>(y), seed, &light);
    filter_row(filter, light, camera.width, rows.data() + y * row);
  });

  const CounterRandom random(sensor.seed, 0x494D4147u + static_cast<std::uint64_t>(frame));
  const auto gain = static_cast<float>(
      exposure(world) * std::exp(sensor.exposure_change * std::clamp(random.normal(0), -2.0, 2.0)));
  std::vector<std::uint8_t> out(row * camera.height);
  const double corner = std::hypot(0.5 * camera.width, 0.5 * camera.height);
  parallel_for(camera.height, num_threads, [&](std::size_t v) {
    std::vector<float> light(row, 0.0f);
    for (std::size_t i = 0; i < filter.weights.size(); ++i) {
      const int y = static_cast<int>(v) * k + filter.first + static_cast<int>(i);
      add_scaled(rows.data() + std::clamp(y, 0, height - 1) * row, filter.weights[i], row,
                 light.data());
    }
    for (int u = 0; u < camera.width; ++u) {
      const double away = std::hypot(u - 0.5 * (camera.width - 1),
                                     static_cast<double>(v) - 0.5 * (camera.height - 1)) /
                          corner;
      const auto shading = static_cast<float>(1.0 - sensor.vignetting * away * away);
      for (int c = 0; c < 3; ++c) {
        const std::size_t at = v * row + 3 * u + c;
        const double grey =
            response(gain * shading * light[3 * u + c]) + sensor.noise * random.normal(8 + at);
        out[at] = static_cast<std::uint8_t>(std::clamp(std::lround(grey), 0l, 255l));
      }
    }
  });
  return out;
}

namespace {

/// Pixels that a car's outline can reach: inclusive ranges of columns and rows, empty if none.
struct PixelRange {
  int u0 = 0, u1 = -1, v0 = 0, v1 = -1;
  bool contains(int u, int v) const { return u >= u0 && u <= u1 && v >= v0 && v <= v1; }
};

PixelRange outline_range(const SynthCar& car, int frame, const SE3& world_from_camera,
                         const PinholeCamera& camera) {
  const SE3 camera_from_vehicle = world_from_camera.inverse() * car.world_from_vehicle[frame];
  double u0 = 1e9, u1 = -1e9, v0 = 1e9, v1 = -1e9;
  int behind = 0, all = 0;
  for (const Eigen::Vector3d& vertex : car.model.mesh.vertices) {
    const Eigen::Vector3d p = camera_from_vehicle * vertex;
    ++all;
    if (p.z() < 0.05) {
      ++behind;
      continue;
    }
    const Eigen::Vector2d pixel = camera.project(p).value();
    u0 = std::min(u0, pixel.x());
    u1 = std::max(u1, pixel.x());
    v0 = std::min(v0, pixel.y());
    v1 = std::max(v1, pixel.y());
  }
  if (behind == all) return {};
  if (behind > 0) return {0, camera.width - 1, 0, camera.height - 1};
  const auto low = [](double x, int n) {
    return static_cast<int>(std::clamp(std::floor(x), 0.0, static_cast<double>(n)));
  };
  return {low(u0, camera.width), low(u1 + 1.0, camera.width), low(v0, camera.height),
          low(v1 + 1.0, camera.height)};
}

TruthLabel label_of(const SynthWorld& world, const WorldHit& hit) {
  if (hit.triangle < 0) return TruthLabel::kSky;
  const SynthMesh& mesh = hit.car < 0 ? world.ground_and_things : world.cars[hit.car].mesh;
  return mesh.objects[mesh.triangles[hit.triangle].object].label;
}

}  // namespace

ViewTruth trace_view(const SynthWorld& world, int frame, const PinholeCamera& camera,
                     int num_threads) {
  ViewTruth out;
  const std::size_t count = static_cast<std::size_t>(camera.width) * camera.height;
  out.hits.resize(count);
  out.labels.resize(count);
  const SE3& world_from_camera = world.views[frame].world_from_camera;
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  const Eigen::Vector3d origin = world_from_camera.translation();
  const std::size_t cars = world.cars.size();
  std::vector<int> outline(cars * camera.height, 0), visible(cars * camera.height, 0);
  std::vector<PixelRange> ranges;
  for (const SynthCar& car : world.cars) {
    ranges.push_back(outline_range(car, frame, world_from_camera, camera));
  }
  parallel_for(camera.height, num_threads, [&](std::size_t v) {
    std::vector<Eigen::Vector3d> directions(camera.width);
    for (int u = 0; u < camera.width; ++u) {
      // The direction's z in the camera is 1, so distances are depths.
      directions[u] = rotation * camera.ray(Eigen::Vector2d(u, static_cast<double>(v)));
    }
    WorldHit* hits = out.hits.data() + v * camera.width;
    cast_rays(world, frame, &origin, false, directions.data(), directions.size(), hits);
    for (int u = 0; u < camera.width; ++u) {
      const WorldHit& hit = hits[u];
      out.labels[v * camera.width + u] = static_cast<std::uint8_t>(label_of(world, hit));
      for (std::size_t i = 0; i < cars; ++i) {
        if (hit.car == static_cast<int>(i)) {
          ++visible[i * camera.height + v];
          ++outline[i * camera.height + v];
        } else if (ranges[i].contains(u, static_cast<int>(v)) &&
                   world.rays->meets_car(frame, static_cast<int>(i), origin, directions[u])) {
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

std::vector<std::uint8_t> trace_labels(const SynthWorld& world, int frame, const ViewCamera& view,
                                       int num_threads) {
  const int width = view.file().width, height = view.file().height;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(width) * height,
                                static_cast<std::uint8_t>(TruthLabel::kSky));
  const SE3& world_from_camera = world.views[frame].world_from_camera;
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  const Eigen::Vector3d origin = world_from_camera.translation();
  parallel_for(height, num_threads, [&](std::size_t v) {
    std::vector<Eigen::Vector3d> directions;
    std::vector<int> columns;
    for (int u = 0; u < width; ++u) {
      const Eigen::Vector3d ray = view.ray(Eigen::Vector2d(u, static_cast<double>(v)));
      if (!ray.allFinite()) continue;
      directions.push_back(rotation * ray);
      columns.push_back(u);
    }
    std::vector<WorldHit> hits(directions.size());
    cast_rays(world, frame, &origin, false, directions.data(), directions.size(), hits.data());
    for (std::size_t i = 0; i < hits.size(); ++i) {
      out[v * width + columns[i]] = static_cast<std::uint8_t>(label_of(world, hits[i]));
    }
  });
  return out;
}

}  // namespace camber
