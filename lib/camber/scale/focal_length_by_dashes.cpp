#include "camber/scale/focal_length_by_dashes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "camber/core/threads.h"

namespace camber {
namespace {

/// A stroke on the ground, m.
struct Stroke {
  Eigen::Vector3d middle, along;
  int rows = 0;                ///< of the image
  double shorter_depth = 0.0;  ///< m, of those by the two focal lengths
};

/// Strokes that lie one period from another or two, along it, each with the length that belongs to
/// that period.
struct BrokenLines {
  std::vector<char> in_line;   // one a stroke
  std::vector<double> ratios;  // of the periods over the known one

  BrokenLines(const std::vector<Stroke>& strokes, const LaneMarkingSizes& sizes)
      : in_line(strokes.size(), 0) {
    // Of logarithms; focal lengths are tried in steps of 0.35.
    constexpr double kMostOff = 0.2, kMostUnlike = 0.2;
    constexpr double kMostTurn = 0.1;  // rad a period
    const double period = sizes.dash_length + sizes.dash_gap;
    for (std::size_t i = 0; i < strokes.size(); ++i) {
      for (std::size_t j = i + 1; j < strokes.size(); ++j) {
        const Eigen::Vector3d step = strokes[j].middle - strokes[i].middle;
        // The stroke between them may be hidden.
        const int periods = step.norm() > M_SQRT2 * period ? 2 : 1;
        const double ratio = step.norm() / (periods * period);
        const auto unlike = [&](const Stroke& stroke) {
          return std::abs(std::log(stroke.along.norm() / (ratio * sizes.dash_length)));
        };
        if (!(std::abs(std::log(ratio)) < kMostOff) ||
            !(std::max(unlike(strokes[i]), unlike(strokes[j])) < kMostUnlike)) {
          continue;
        }
        const auto turn = [&](const Stroke& stroke) {
          return std::atan2(step.cross(stroke.along).norm(), step.dot(stroke.along));
        };
        if (std::max(turn(strokes[i]), turn(strokes[j])) > periods * kMostTurn) continue;
        in_line[i] = in_line[j] = 1;
        ratios.push_back(ratio);
      }
    }
  }

  int strokes() const { return static_cast<int>(std::count(in_line.begin(), in_line.end(), 1)); }
};

/// The longest stroke near the camera that has the known length; null: none.
const Stroke* near_stroke(const std::vector<Stroke>& strokes, double dash_length) {
  constexpr int kFewestRows = 20;
  constexpr double kFarthest = 25.0, kMostOff = 0.1;  // m; of the logarithm
  const Stroke* out = nullptr;
  for (const Stroke& stroke : strokes) {
    if (stroke.rows >= kFewestRows && stroke.shorter_depth < kFarthest &&
        std::abs(std::log(stroke.along.norm() / dash_length)) < kMostOff &&
        (!out || stroke.rows > out->rows)) {
      out = &stroke;
    }
  }
  return out;
}

/// A camera, ground and direction with the depths of another focal length.
struct Stretched {
  PinholeCamera camera;
  GroundRaster ground;
  Eigen::Vector3d ahead;

  Stretched(const PinholeCamera& from, const GroundRaster& raster, const Eigen::Vector3d& travel,
            double factor)
      : camera(from), ground(raster), ahead(travel.x(), travel.y(), factor * travel.z()) {
    camera.fx *= factor;
    camera.fy *= factor;
    const auto by = static_cast<float>(1.0 / factor);
    for (float& rho : ground.inverse_depth) rho *= by;
    ahead.normalize();
  }

  Eigen::Vector3d point(const Eigen::Vector2d& pixel) const {
    const int u = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, camera.width - 1);
    const int v =
        std::clamp(static_cast<int>(std::lround(pixel.y())), ground.top, camera.height - 1);
    const auto at =
        static_cast<std::size_t>(v - ground.top) * static_cast<std::size_t>(camera.width) +
        static_cast<std::size_t>(u);
    return camera.ray(pixel) / std::max(1e-6F, ground.inverse_depth[at]);
  }
};

LaneMarkingSizes sizes_of_dashes(const LaneMarkingSizes& sizes) {
  LaneMarkingSizes out;
  out.dash_length = sizes.dash_length;
  out.dash_gap = sizes.dash_gap;
  out.line_width = sizes.line_width;
  return out;
}

/// @param shorter  of the depths of two focal lengths over those of this one.
std::vector<Stroke> strokes_of(const GrayImage& image, const Stretched& view,
                               const LaneMarkingSizes& of_dashes, double scale_sigma,
                               double shorter, int num_threads) {
  // Bars of few rows have any length, and those far ahead or aside that of the ground's errors.
  constexpr int kFewestRows = 5;
  constexpr double kFarthest = 40.0, kMostAside = 4.0;  // m
  std::vector<Stroke> out;
  const LaneMarkings markings = detect_lane_markings(image, view.camera, view.ground, view.ahead,
                                                     of_dashes, scale_sigma, num_threads);
  for (const PaintedDash& dash : markings.dashes) {
    const Eigen::Vector3d along = view.point(dash.far_end) - view.point(dash.near_end);
    const Eigen::Vector3d middle = view.point(dash.centroid);
    const double shorter_depth = middle.z() * shorter;
    if (dash.rows < kFewestRows || shorter_depth > kFarthest || std::abs(middle.x()) > kMostAside) {
      continue;
    }
    out.push_back({middle, along, dash.rows, shorter_depth});
  }
  return out;
}

}  // namespace

DashFocalLength focal_length_by_dashes(const GrayImage& image, const PinholeCamera& camera,
                                       const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                       const LaneMarkingSizes& sizes, double scale_sigma,
                                       int num_threads) {
  DashFocalLength out;
  if (!sizes.dashes()) return out;
  const LaneMarkingSizes of_dashes = sizes_of_dashes(sizes);
  constexpr std::array<double, 5> kFactors = {1.0, 0.5, M_SQRT1_2, M_SQRT2, 2.0};
  // With these alone a single stroke counts: what has 0.7 times the known length may be a stroke on
  // ground that is a third off.
  constexpr std::array<bool, kFactors.size()> kGross = {false, true, false, false, true};
  constexpr double kAlike = 0.3;  // of lengths' logarithms
  std::array<DashFocalLength, kFactors.size()> found;
  std::array<std::vector<Stroke>, kFactors.size()> seen;
  parallel_for(kFactors.size(), num_threads, [&](std::size_t k) {
    const Stretched other(camera, ground, ahead, kFactors[k]);
    std::vector<Stroke>& strokes = seen[k];
    strokes = strokes_of(image, other, of_dashes, scale_sigma, std::min(1.0, 1.0 / kFactors[k]), 1);
    BrokenLines lines(strokes, of_dashes);
    found[k].strokes = lines.strokes();
    if (lines.ratios.empty()) return;
    const auto middle = lines.ratios.begin() + static_cast<std::ptrdiff_t>(lines.ratios.size() / 2);
    std::nth_element(lines.ratios.begin(), middle, lines.ratios.end());
    found[k].factor = kFactors[k] / *middle;
  });
  for (std::size_t k = 1; k < found.size(); ++k) {
    if (found[k].strokes > std::max(out.strokes, found[0].strokes)) out = found[k];
  }
  const bool fits = std::any_of(seen[0].begin(), seen[0].end(), [&](const Stroke& stroke) {
    return std::abs(std::log(stroke.along.norm() / of_dashes.dash_length)) < kAlike;
  });
  if (out.strokes > 0 || found[0].strokes > 0 || fits) return out;
  for (std::size_t k = 1; k < found.size(); ++k) {
    const Stroke* stroke = kGross[k] ? near_stroke(seen[k], of_dashes.dash_length) : nullptr;
    if (!stroke) continue;
    if (out.strokes > 0) return {};  // one stroke asks for half, another for twice
    out = {kFactors[k] * of_dashes.dash_length / stroke->along.norm(), 1};
  }
  return out;
}

BrokenLineRatios broken_line_ratios(const GrayImage& image, const PinholeCamera& camera,
                                    const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                    const LaneMarkingSizes& sizes, double scale_sigma,
                                    int num_threads) {
  BrokenLineRatios out;
  if (!sizes.dashes()) return out;
  const LaneMarkingSizes of_dashes = sizes_of_dashes(sizes);
  const Stretched view(camera, ground, ahead, 1.0);
  const std::vector<Stroke> strokes =
      strokes_of(image, view, of_dashes, scale_sigma, 1.0, num_threads);
  BrokenLines lines(strokes, of_dashes);
  out.strokes = lines.strokes();
  out.periods = std::move(lines.ratios);
  if (!(sizes.lane_width > 0.0)) return out;
  constexpr double kMostOff = 0.2, kMostTurn = 0.1;  // of the logarithm; rad
  for (std::size_t i = 0; i < strokes.size(); ++i) {
    for (std::size_t j = i + 1; j < strokes.size(); ++j) {
      if (!lines.in_line[i] || !lines.in_line[j]) continue;
      const Eigen::Vector3d along = (strokes[i].along + strokes[j].along).normalized();
      const double turn = strokes[i].along.normalized().cross(strokes[j].along.normalized()).norm();
      const double across = along.cross(strokes[j].middle - strokes[i].middle).norm();
      const double ratio = across / sizes.lane_width;
      if (turn < kMostTurn && std::abs(std::log(ratio)) < kMostOff) out.sidewise.push_back(ratio);
    }
  }
  return out;
}

}  // namespace camber
