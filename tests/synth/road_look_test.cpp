// What the carriageway looks like: textures, wetness, and that pictures agree with the truth.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/synth/detail/ground_objects.h"
#include "camber/synth/detail/ground_textures.h"
#include "camber/synth/synthesise.h"

namespace camber {
namespace {

SynthOptions small_options(std::uint64_t seed) {
  SynthOptions options;
  options.profile = RoadProfileKind::kUphill;
  options.seed = seed;
  options.camera = {320, 160, 200.0, 200.0, 159.5, 70.0};
  options.num_frames = 2;
  options.num_threads = 2;
  options.num_cars = 0;
  options.sensor.supersampling = 2;
  options.sensor.noise = 0.0;
  options.sensor.exposure_change = 0.0;
  return options;
}

SynthWorld bare_world(const SynthOptions& options) {
  WorldOptions world = world_options(options);
  world.scenery = false;
  return make_synth_world(world);
}

using Grey = std::vector<double>;

Grey grey_picture(const SynthWorld& world, int frame, const SynthOptions& options) {
  CameraSensor sensor = options.sensor;
  sensor.seed = options.seed;
  const auto rgb = render_view(world, frame, options.camera, sensor, 2);
  Grey out(rgb.size() / 3);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = rgb[3 * i + 1];
  return out;
}

/// Value between pixels; NaN outside.
double sample(const Grey& image, const PinholeCamera& camera, const Eigen::Vector2d& p) {
  const int u = static_cast<int>(std::floor(p.x())), v = static_cast<int>(std::floor(p.y()));
  if (u < 0 || v < 0 || u + 1 >= camera.width || v + 1 >= camera.height) return std::nan("");
  const double a = p.x() - u, b = p.y() - v;
  const auto at = [&](int x, int y) {
    return image[static_cast<std::size_t>(y) * camera.width + x];
  };
  return (1 - b) * ((1 - a) * at(u, v) + a * at(u + 1, v)) +
         b * ((1 - a) * at(u, v + 1) + a * at(u + 1, v + 1));
}

/// Where truth says that the road's pixels of frame 0 are in frame 1, against where the pictures
/// show them: sub-pixel shifts of windows by least squares (Lucas and Kanade, 1981).
std::vector<double> window_shifts(const SynthWorld& world, const SynthOptions& options) {
  const PinholeCamera& camera = options.camera;
  const Grey first = grey_picture(world, 0, options), second = grey_picture(world, 1, options);
  const ViewTruth truth = trace_view(world, 0, camera, 2);
  const SE3 second_from_first =
      world.views[1].world_from_camera.inverse() * world.views[0].world_from_camera;
  // The second picture as frame 0 would see it.
  Grey warped(first.size(), std::nan(""));
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const std::size_t at = static_cast<std::size_t>(v) * camera.width + u;
      if (truth.labels[at] != static_cast<std::uint8_t>(TruthLabel::kRoad)) continue;
      if (truth.hits[at].distance > 12.0) continue;
      const auto pixel =
          camera.project(second_from_first * (truth.hits[at].distance * camera.ray({u, v})));
      if (pixel) warped[at] = sample(second, camera, *pixel);
    }
  }
  constexpr int kReach = 7;
  std::vector<double> shifts;
  for (int v = kReach + 1; v < camera.height - kReach - 1; v += 8) {
    for (int u = kReach + 1; u < camera.width - kReach - 1; u += 8) {
      Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
      Eigen::Vector3d right = Eigen::Vector3d::Zero();
      bool whole = true;
      for (int dv = -kReach; dv <= kReach && whole; ++dv) {
        for (int du = -kReach; du <= kReach; ++du) {
          const std::size_t at = static_cast<std::size_t>(v + dv) * camera.width + u + du;
          const double gx = 0.5 * (warped[at + 1] - warped[at - 1]);
          const double gy = 0.5 * (warped[at + camera.width] - warped[at - camera.width]);
          const double difference = first[at] - warped[at];
          if (!std::isfinite(gx + gy + difference)) {
            whole = false;
            break;
          }
          const Eigen::Vector3d row(gx, gy, 1.0);
          normal += row * row.transpose();
          right += difference * row;
        }
      }
      if (!whole) continue;
      // Enough texture to say something: half a grey level a pixel in every direction.
      const double least =
          normal.topLeftCorner<2, 2>().selfadjointView<Eigen::Lower>().eigenvalues().minCoeff();
      if (least < 0.25 * (2 * kReach + 1) * (2 * kReach + 1)) continue;
      shifts.push_back(normal.ldlt().solve(right).head<2>().norm());
    }
  }
  std::sort(shifts.begin(), shifts.end());
  return shifts;
}

TEST(RoadLook, PicturesAgreeWithTrueDepthAndPosesToAQuarterPixel) {
  for (int kind = 0; kind < 5; ++kind) {
    SynthOptions options = small_options(3 + kind);
    SceneFeatures& features = options.features;
    features.markings = Markings::kNone;
    features.weather.cloudiness = 1.0;  // no shadows, whose edges are blurred at random
    options.speed = 6.0;
    if (kind == 1) features.asphalt.texture = AsphaltTexture::kSelfSimilar;
    if (kind == 2) features.asphalt.texture = AsphaltTexture::kRepeating;
    if (kind == 3) features.bend = {45.0, TurnDirection::kLeft};
    if (kind == 4) {
      features.corner.enabled = true;
      features.mounting.ahead_of_axle = 1.5;
      options.frame_rate = 15.0;
    }
    const std::vector<double> shifts = window_shifts(bare_world(options), options);
    ASSERT_GT(shifts.size(), 40u) << kind;
    // What remains is interpolation of a texture that has been seen at another scale.
    EXPECT_LT(shifts[shifts.size() / 2], 0.10) << kind;
    EXPECT_LT(shifts[shifts.size() * 9 / 10], 0.25) << kind;
  }
}

// ---------------------------------------------------------------- textures

/// log reflectance along a line across the texture, `step` m apart.
std::vector<double> texture_line(AsphaltTexture texture, double step, int count, double angle,
                                 std::uint32_t seed) {
  SynthOptions options = small_options(1);
  options.features.asphalt.texture = texture;
  options.features.markings = Markings::kNone;
  static const SynthWorld varied = bare_world(options);
  SynthWorld world = varied;
  world.asphalt.texture = texture;
  const SynthObject object = asphalt_object(3.5, 1.0f, false, seed);
  std::vector<double> out;
  for (int first = 0; first < count; first += TexelChunk::kMost) {
    const int n = std::min(TexelChunk::kMost, count - first);
    std::vector<float> u(n), v(n), width(n, 0.001f), red(n), green(n), blue(n);
    for (int i = 0; i < n; ++i) {
      u[i] = static_cast<float>(30.0 + (first + i) * step * std::cos(angle));
      v[i] = static_cast<float>(0.3 + (first + i) * step * std::sin(angle));
    }
    const TexelChunk chunk{n, u.data(), v.data(), width.data(), 0.001f};
    float* const rgb[3] = {red.data(), green.data(), blue.data()};
    ground_reflectance(world, object, chunk, rgb);
    for (int i = 0; i < n; ++i) out.push_back(std::log(green[i]));
  }
  return out;
}

double mean_square_step(const std::vector<double>& values, int lag) {
  double sum = 0.0;
  for (std::size_t i = 0; i + lag < values.size(); ++i) {
    sum += (values[i + lag] - values[i]) * (values[i + lag] - values[i]);
  }
  return sum / static_cast<double>(values.size() - lag);
}

TEST(RoadLook, SelfSimilarAsphaltIsAlikeAtEveryScale) {
  // With equal power an octave, the mean square difference of two places grows by the same amount
  // each time that their distance doubles, from centimetres to metres.
  std::vector<double> growth(6, 0.0);
  for (std::uint32_t seed = 0; seed < 12; ++seed) {
    const auto line = texture_line(AsphaltTexture::kSelfSimilar, 0.01, 6000, 0.35, 100 + seed);
    for (int i = 0; i < 6; ++i) {
      growth[i] += (mean_square_step(line, 4 << i) - mean_square_step(line, 2 << i)) / 12.0;
    }
  }
  double mean = 0.0;
  for (const double g : growth) mean += g / 6.0;
  EXPECT_GT(mean, 0.001);
  for (const double g : growth) EXPECT_NEAR(g / mean, 1.0, 0.5);
}

TEST(RoadLook, RepeatingAsphaltLooksAlmostTheSameOneTileOn) {
  const std::uint32_t seed = 77;
  const double side = 0.45 + 0.9 * hash_unit(3, 1, seed);
  const double step = side / 128.0;
  const auto line = texture_line(AsphaltTexture::kRepeating, step, 5000, 0.0, seed);
  const double tile = mean_square_step(line, 128), half = mean_square_step(line, 53);
  EXPECT_LT(tile, 0.35 * half);
  // Not altogether: amplitudes of 0.09 and 0.07 in nine of 0.30 do not repeat, 2 % of the power.
  EXPECT_GT(tile, 0.01 * half);
}

// ---------------------------------------------------------------- wet

TEST(RoadLook, WetAsphaltIsDarkerFromAboveAndMirrorsTheSkyFarAway) {
  // At 20 degrees water already mirrors an eighth of the light: a wide view down to 60.
  SynthOptions options = small_options(5);
  options.profile = RoadProfileKind::kLevel;
  options.camera.fx = options.camera.fy = 100.0;
  options.features.mounting.pitch = -0.35;
  options.features.markings = Markings::kNone;
  options.features.weather.cloudiness = 1.0;
  const auto bands = [&](double wetness) {
    options.features.asphalt.wetness = wetness;
    const SynthWorld world = bare_world(options);
    const Grey image = grey_picture(world, 0, options);
    const ViewTruth truth = trace_view(world, 0, options.camera, 2);
    Eigen::Vector2d sum(0, 0), count(0, 0);
    for (std::size_t i = 0; i < image.size(); ++i) {
      if (truth.labels[i] != static_cast<std::uint8_t>(TruthLabel::kRoad)) continue;
      const int u = static_cast<int>(i) % options.camera.width;
      const int v = static_cast<int>(i) / options.camera.width;
      const Eigen::Vector3d view =
          world.views[0].world_from_camera.rotation() * options.camera.ray(Eigen::Vector2d(u, v));
      const double down = std::asin(-view.normalized().z());
      const int band = down > 0.8 ? 0 : (down < 0.12 ? 1 : -1);
      if (band < 0) continue;
      sum[band] += image[i];
      ++count[band];
    }
    EXPECT_GT(count.minCoeff(), 200);
    return Eigen::Vector2d(sum.cwiseQuotient(count));
  };
  const Eigen::Vector2d dry = bands(0.0), wet = bands(1.0);
  EXPECT_LT(wet[0], dry[0] - 15.0);
  EXPECT_GT(wet[1], dry[1] + 15.0);
}

TEST(RoadLook, WetAsphaltMirrorsTheLampsOfACarAhead) {
  SynthOptions options = small_options(6);
  options.profile = RoadProfileKind::kLevel;
  options.features.lead_car = {true, 7.0};
  options.features.weather.cloudiness = 1.0;
  options.features.markings = Markings::kNone;
  const auto red_excess = [&](double wetness, bool lamps) {
    options.features.asphalt.wetness = wetness;
    options.features.weather.lights_on = lamps;
    const SynthWorld world = bare_world(options);
    CameraSensor sensor = options.sensor;
    const auto rgb = render_view(world, 0, options.camera, sensor, 2);
    const ViewTruth truth = trace_view(world, 0, options.camera, 2);
    double sum = 0.0;
    for (std::size_t i = 0; i < truth.labels.size(); ++i) {
      if (truth.labels[i] != static_cast<std::uint8_t>(TruthLabel::kRoad)) continue;
      if (truth.hits[i].distance > 6.0) continue;  // beside the car the lens blurs the lamps
      sum += std::max(0, rgb[3 * i] - rgb[3 * i + 1] - 6);
    }
    return sum;
  };
  const double dry = red_excess(0.0, true), dark = red_excess(1.0, false),
               wet = red_excess(1.0, true);
  EXPECT_GT(wet, 300.0);
  EXPECT_GT(wet, 4.0 * dark);
  EXPECT_GT(wet, 4.0 * dry);
}

TEST(RoadLook, ReflectionsDependOnTheViewWhereDryAsphaltDoesNot) {
  // The same places of the road in two frames: their brightness differs by more when it is wet.
  const auto change = [&](double wetness) {
    SynthOptions options = small_options(8);
    options.profile = RoadProfileKind::kLevel;
    options.speed = 30.0;
    options.features.markings = Markings::kNone;
    options.features.weather.cloudiness = 1.0;
    options.features.asphalt.wetness = wetness;
    const SynthWorld world = bare_world(options);
    const Grey first = grey_picture(world, 0, options), second = grey_picture(world, 1, options);
    const ViewTruth truth = trace_view(world, 0, options.camera, 2);
    const SE3 second_from_first =
        world.views[1].world_from_camera.inverse() * world.views[0].world_from_camera;
    double sum = 0.0;
    int count = 0;
    for (int v = 0; v < options.camera.height; ++v) {
      for (int u = 0; u < options.camera.width; ++u) {
        const std::size_t at = static_cast<std::size_t>(v) * options.camera.width + u;
        if (truth.labels[at] != static_cast<std::uint8_t>(TruthLabel::kRoad)) continue;
        if (truth.hits[at].distance > 14.0 || truth.hits[at].distance < 8.0) continue;
        const auto pixel = options.camera.project(
            second_from_first * (truth.hits[at].distance * options.camera.ray({u, v})));
        if (!pixel) continue;
        const double there = sample(second, options.camera, *pixel);
        if (std::isnan(there)) continue;
        sum += there - first[at];
        ++count;
      }
    }
    EXPECT_GT(count, 200);
    return sum / count;
  };
  EXPECT_LT(std::abs(change(0.0)), 4.0);
  EXPECT_LT(change(1.0), -6.0);  // nearer, the road mirrors less of the sky
}

}  // namespace
}  // namespace camber
