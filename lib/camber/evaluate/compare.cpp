#include "camber/evaluate/compare.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/evaluate/detail/compare_steps.h"

namespace camber {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The longest range of the truth in each direction from where it was seen.
class ObservedSpace {
 public:
  ObservedSpace(const std::vector<Vector3d>& truth, const Vector3d& viewpoint, double slack)
      : viewpoint_(viewpoint),
        slack_(slack),
        ranges_(static_cast<std::size_t>(kColumns) * kRows, -1.0f) {
    for (const Vector3d& p : truth) {
      const Vector3d ray = p - viewpoint;
      if (!ray.allFinite() || ray.isZero()) continue;
      float& range = ranges_[cell(ray, 0, 0)];
      range = std::max(range, static_cast<float>(ray.norm()));
    }
  }

  bool contains(const Vector3d& place) const {
    const Vector3d ray = place - viewpoint_;
    if (!ray.allFinite() || ray.isZero()) return true;
    float longest = -1.0f;
    for (int row = -1; row <= 1; ++row) {
      for (int column = -1; column <= 1; ++column) {
        longest = std::max(longest, ranges_[cell(ray, column, row)]);
      }
    }
    return longest >= 0.0f && ray.norm() <= static_cast<double>(longest) + slack_;
  }

 private:
  static constexpr int kColumns = 720, kRows = 360;  // half a degree

  static std::size_t cell(const Vector3d& ray, int column, int row) {
    const double azimuth = std::atan2(ray.y(), ray.x()) / (2.0 * M_PI) + 0.5;
    const double elevation = std::asin(std::clamp(ray.z() / ray.norm(), -1.0, 1.0)) / M_PI + 0.5;
    const int c = (static_cast<int>(azimuth * kColumns) + column + kColumns) % kColumns;
    const int r = std::clamp(static_cast<int>(elevation * kRows) + row, 0, kRows - 1);
    return static_cast<std::size_t>(r) * kColumns + static_cast<std::size_t>(c);
  }
  Vector3d viewpoint_;
  double slack_;
  std::vector<float> ranges_;
};

bool seen(const std::vector<View>& views, double farthest, const Vector3d& place) {
  for (const View& view : views) {
    const Vector3d p = view.camera_from_estimate * place;
    if (!(p.z() > 0.1 && p.z() <= farthest)) continue;
    const std::optional<Eigen::Vector2d> pixel = view.camera.project(p);
    if (pixel && view.camera.contains(*pixel, -0.5)) {
      return true;
    }
  }
  return false;
}

std::vector<double> counted_values(const DirectedDistances& directed,
                                   const std::vector<double>& values) {
  std::vector<double> out;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (directed.counted[i] != 0 && std::isfinite(values[i])) out.push_back(values[i]);
  }
  return out;
}

double share_within(const std::vector<double>& values, double threshold) {
  if (values.empty()) return 0.0;
  const auto within =
      std::count_if(values.begin(), values.end(), [&](double v) { return v <= threshold; });
  return static_cast<double>(within) / static_cast<double>(values.size());
}

/// The box of the finite points of a shape.
Eigen::AlignedBox3d box_of(const Shape& shape) {
  Eigen::AlignedBox3d box;
  for (std::size_t i = 0; i < shape.cloud.size(); ++i) {
    const Vector3d p = detail::true_point(shape.cloud, i);
    if (p.allFinite()) box.extend(p);
  }
  return box;
}

/// Refuses shapes of different places: from so far off nearly all points of the one are as near to
/// the other, which no search shortens, and no threshold separates them.
/// @throws NoAnswerError
void require_one_place(const Shape& estimate, const Shape& truth) {
  constexpr double kFarthest = 1e4;       // m
  constexpr double kMostDiagonals = 100;  // of the larger box
  const Eigen::AlignedBox3d a = box_of(estimate), b = box_of(truth);
  if (a.isEmpty() || b.isEmpty()) return;
  const double apart = a.exteriorDistance(b);
  const double diagonal = std::max(a.diagonal().norm(), b.diagonal().norm());
  if (!(apart > std::max(kFarthest, kMostDiagonals * diagonal))) return;
  throw NoAnswerError(
      fmt::format("nothing to compare: the estimate lies {:.0f} km from the truth, expected one "
                  "place (--align rigid or --estimate-from-truth would move them there)",
                  apart / 1e3));
}

/// Which points count, and why others do not. @param observed  of a place
template <typename Observed>
void sort_out(const RoadCloud& cloud, const CompareOptions& options, DirectedDistances& directed,
              const Observed& observed) {
  directed.counted.assign(cloud.size(), 1);
  struct Left {
    std::size_t not_finite = 0, outside = 0, unobserved = 0;
  };
  constexpr std::size_t kBlock = 65536;
  std::vector<Left> blocks((cloud.size() + kBlock - 1) / kBlock);
  parallel_for(blocks.size(), options.num_threads, [&](std::size_t block) {
    Left& left = blocks[block];
    for (std::size_t i = block * kBlock; i < std::min(cloud.size(), (block + 1) * kBlock); ++i) {
      const Vector3d place = detail::true_point(cloud, i);
      std::size_t* reason = nullptr;
      if (!place.allFinite()) {
        reason = &left.not_finite;
      } else if (options.region && !options.region->contains(place)) {
        reason = &left.outside;
      } else if (!observed(place)) {
        reason = &left.unobserved;
      }
      if (reason == nullptr) continue;
      ++*reason;
      directed.counted[i] = 0;
    }
  });
  for (const Left& left : blocks) {
    directed.not_finite += left.not_finite;
    directed.outside += left.outside;
    directed.unobserved += left.unobserved;
  }
}

/// The statistics of both directions.
/// @param has_normals  whether the truth came with normals
/// @throws NoAnswerError
void summarise(bool has_normals, const CompareOptions& options, CloudComparison& out) {
  struct Side {
    std::vector<double> values;
    std::vector<double> shares;  // within each threshold
  };
  Side accuracy, completeness;
  const auto measure = [&](DirectedDistances& directed, bool along_normal, Side& side) {
    side.values = counted_values(directed, directed.distances.distance);
    if (side.values.empty()) return;
    directed.summary = summarise_distances(side.values);
    for (const double threshold : options.thresholds) {
      side.shares.push_back(share_within(side.values, threshold));
    }
    if (!along_normal) return;
    directed.along_normal =
        summarise_distances(counted_values(directed, directed.distances.along_normal));
  };
  parallel_for(2, options.num_threads, [&](std::size_t side) {
    if (side == 0) {
      measure(out.accuracy, has_normals, accuracy);
    } else {
      measure(out.completeness, true, completeness);
    }
  });
  if (accuracy.values.empty() || completeness.values.empty()) {
    throw NoAnswerError(accuracy.values.empty() && completeness.values.empty()
                            ? "nothing to compare: no points left on either side"
                        : accuracy.values.empty()
                            ? "nothing to compare: no points of the estimate are left"
                            : "nothing to compare: no points of the truth are left");
  }
  for (std::size_t k = 0; k < options.thresholds.size(); ++k) {
    ThresholdScore score;
    score.threshold = options.thresholds[k];
    score.precision = accuracy.shares[k];
    score.recall = completeness.shares[k];
    const double sum = score.precision + score.recall;
    score.f_score = sum > 0.0 ? 2.0 * score.precision * score.recall / sum : 0.0;
    out.scores.push_back(score);
  }
}

}  // namespace

std::string to_string(Alignment alignment) {
  switch (alignment) {
    case Alignment::kNone:
      return "none";
    case Alignment::kScale:
      return "scale";
    case Alignment::kRigid:
      return "rigid";
    case Alignment::kSimilarity:
      return "similarity";
  }
  return "";
}

void CompareOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (good) return;
    throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                                expected);
  };
  require(!thresholds.empty(), "thresholds", 0.0, "at least one");
  for (const double t : thresholds) {
    require(std::isfinite(t) && t > 0.0, "thresholds", t, "positive numbers of metres");
  }
  require(estimate_from_truth.allFinite() &&
              std::abs(estimate_from_truth.topLeftCorner<3, 3>().determinant()) > 0.0,
          "estimate_from_truth", 0.0, "an invertible matrix");
  if (!pairs.empty()) {
    require(alignment != Alignment::kNone, "pairs", static_cast<double>(pairs.size()),
            "an alignment to use them for");
    require(alignment == Alignment::kScale || pairs.size() >= 3, "pairs",
            static_cast<double>(pairs.size()), "at least 3");
    for (const auto& [a, b] : pairs) {
      require(a.allFinite() && b.allFinite(), "pairs", kNaN, "finite numbers");
    }
  }
  require(farthest > 0.0, "farthest", farthest, "a positive number of metres");
  require(up.allFinite() && up.norm() > 0.0, "up", up.norm(), "a direction");
  require(along.allFinite() && along.cross(up).norm() > 1e-9 * along.norm() * up.norm(), "along",
          along.norm(), "a direction that is not upright");
  require(road_limit > 0.0, "road_limit", road_limit, "a positive number of metres");
  require(std::isfinite(map_cell) && map_cell > 0.0, "map_cell", map_cell,
          "a positive number of metres");
  require(std::isfinite(mesh_density) && mesh_density > 0.0, "mesh_density", mesh_density,
          "a positive number");
}

DistanceSummary summarise_distances(const std::vector<double>& values) {
  DistanceSummary out;
  std::vector<double> sizes;
  sizes.reserve(values.size());
  for (const double v : values) {
    if (std::isfinite(v)) sizes.push_back(std::abs(v));
  }
  out.count = sizes.size();
  if (sizes.empty()) return out;
  double sum = 0.0, squares = 0.0;
  for (const double v : sizes) {
    sum += v;
    squares += v * v;
    out.largest = std::isnan(out.largest) ? v : std::max(out.largest, v);
  }
  const double n = static_cast<double>(sizes.size());
  auto sorted = sizes.begin();  // all before it are no larger than those behind
  const auto quantile = [&](double share) {
    const std::size_t at = std::min(sizes.size() - 1, static_cast<std::size_t>(share * n));
    const auto place = sizes.begin() + static_cast<std::ptrdiff_t>(at);
    std::nth_element(sorted, place, sizes.end());
    sorted = place;
    return *place;
  };
  out.mean = sum / n;
  out.rms = std::sqrt(squares / n);
  out.median = quantile(0.5);
  out.quantile_90 = quantile(0.9);
  out.quantile_95 = quantile(0.95);
  return out;
}

CloudComparison compare_shapes(const Shape& estimate_in, const Shape& truth_in,
                               const CompareOptions& options) {
  options.validate();
  estimate_in.cloud.validate();
  truth_in.cloud.validate();
  constexpr std::size_t kMostSamples = 2000000;
  CloudComparison out;
  const bool scales =
      options.alignment == Alignment::kScale || options.alignment == Alignment::kSimilarity;
  out.metric = truth_in.cloud.metric && (scales || estimate_in.cloud.metric);
  Shape truth = detail::transformed(truth_in, options.estimate_from_truth);
  if (options.alignment == Alignment::kNone) require_one_place(estimate_in, truth);

  // What is measured of a mesh are points spread over it.
  const auto sampled = [&](const Shape& shape) {
    return shape.is_mesh() ? sample_mesh(shape, options.mesh_density, kMostSamples, options.seed)
                           : RoadCloud();
  };
  std::optional<detail::ShapeSearch> truth_search(std::in_place, truth, options.num_threads);
  const bool iterates = options.alignment != Alignment::kNone && options.pairs.empty();
  if ((options.road_frame || iterates) && !truth.is_mesh() && truth.cloud.normals.empty()) {
    truth.cloud.normals = detail::tangent_normals(truth.cloud, *truth_search->point_tree(),
                                                  options.up, options.num_threads);
  }
  if (options.alignment != Alignment::kNone) {
    out.alignment =
        iterates ? detail::iterate_closest(true_points(estimate_in.is_mesh() ? sampled(estimate_in)
                                                                             : estimate_in.cloud),
                                           truth, *truth_search, options.alignment)
                 : detail::align_pairs(options);
  }
  Shape estimate = detail::transformed(estimate_in, out.alignment.transform);
  if (options.alignment != Alignment::kNone) require_one_place(estimate, truth);
  std::optional<detail::ShapeSearch> estimate_search(std::in_place, estimate, options.num_threads);
  RoadCloud estimate_sample = sampled(estimate), truth_sample = sampled(truth);
  RoadCloud& estimated = estimate.is_mesh() ? estimate_sample : estimate.cloud;
  RoadCloud& true_cloud = truth.is_mesh() ? truth_sample : truth.cloud;
  out.accuracy.distances = truth_search->distances_of(*estimate_search, estimated);
  out.completeness.distances = estimate_search->distances_of(*truth_search, true_cloud);
  truth_search.reset();
  estimate_search.reset();

  if (options.truth_viewpoint) {
    const ObservedSpace space(
        true_points(truth_in.is_mesh() ? sampled(truth_in) : truth_in.cloud),
        *options.truth_viewpoint,
        *std::max_element(options.thresholds.begin(), options.thresholds.end()));
    const Matrix4d truth_from_estimate = options.estimate_from_truth.inverse();
    sort_out(estimated, options, out.accuracy, [&](const Vector3d& p) {
      return space.contains(detail::move(truth_from_estimate, p));
    });
  } else {
    sort_out(estimated, options, out.accuracy, [](const Vector3d&) { return true; });
  }
  sort_out(true_cloud, options, out.completeness, [&](const Vector3d& p) {
    return options.views.empty() || seen(options.views, options.farthest, p);
  });

  // Normals that were only estimated here serve the road's frame, not this.
  summarise(truth_in.is_mesh() || !truth_in.cloud.normals.empty(), options, out);
  if (options.road_frame) detail::add_road_errors(truth, estimated, options, &out);
  out.accuracy.points = std::move(estimated);
  out.completeness.points = std::move(true_cloud);
  out.accuracy.points.metric = out.completeness.points.metric = out.metric;
  return out;
}

}  // namespace camber
