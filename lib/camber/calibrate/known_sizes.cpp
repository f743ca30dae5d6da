#include "camber/calibrate/known_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/scale/focal_length_by_dashes.h"
#include "camber/scale/scale_noise.h"
#include "camber/scene/marking_presets.h"
#include "camber/vehicle/focal_length.h"
#include "camber/vehicle/support_plane.h"

namespace camber {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// The road in metres, the camera being as high as is taken for now.
Plane road_in_metres(const RoadView& view, const CameraSoFar& so_far) {
  return {view.road.normal, std::exp(so_far.log_height)};
}

/// A vehicle in one frame, with several focal lengths.
struct SeenVehicle {
  std::size_t view = 0;
  const VehicleDetection* detection = nullptr;
  FocalLengthProfile profile;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();  // on the ground, heights of the camera
};

/// Changes of the focal length's logarithm that are tried, evenly spaced about none.
std::vector<double> tried_changes(double sigma) {
  constexpr double kSigmas = 2.5, kNarrowest = 0.2, kWidest = 0.8;
  constexpr int kEachSide = 4;
  const double reach = std::clamp(kSigmas * sigma, kNarrowest, kWidest);
  std::vector<double> out;
  for (int k = -kEachSide; k <= kEachSide; ++k) out.push_back(reach * k / kEachSide);
  return out;
}

/// Detections with keypoints, the largest in the image.
std::vector<SeenVehicle> largest_vehicles(const Scene& scene, const std::vector<RoadView>& views,
                                          const CameraSoFar& so_far, std::size_t most) {
  std::vector<SeenVehicle> out;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const SceneFrame* frame = scene.find_frame(views[v].frame_id);
    if (!frame) continue;
    const Plane road = road_in_metres(views[v], so_far);
    for (const VehicleDetection& detection : frame->vehicles) {
      if (detection.keypoints.empty() || !(detection.box.height() > 0.0)) continue;
      const auto foot =
          road.intersect_ray(scene.camera.ray({detection.box.center().x(), detection.box.y2}));
      if (!foot) continue;
      SeenVehicle seen;
      seen.view = v;
      seen.detection = &detection;
      seen.place = *foot / road.offset;
      out.push_back(std::move(seen));
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const SeenVehicle& a, const SeenVehicle& b) {
    return a.detection->box.height() > b.detection->box.height();
  });
  if (out.size() > most) out.resize(most);
  std::stable_sort(out.begin(), out.end(),
                   [](const SeenVehicle& a, const SeenVehicle& b) { return a.view < b.view; });
  return out;
}

/// Whether two detections of successive views may show one vehicle: it moves with the camera, or
/// stands where the drive brings it.
bool may_be_one(const SeenVehicle& a, const SeenVehicle& b, const std::vector<RoadView>& views) {
  const int track_a = a.detection->track, track_b = b.detection->track;
  if (track_a >= 0 && track_b >= 0) return track_a == track_b;
  constexpr double kOverlap = 0.3;  // IoU
  constexpr double kNear = 2.0;     // heights of the camera
  if (intersection_over_union(a.detection->box, b.detection->box) > kOverlap) return true;
  const double driven = views[b.view].along - views[a.view].along;
  return (a.place - driven * views[a.view].ahead - b.place).norm() < kNear;
}

/// Vehicle number of each, from 0.
std::vector<int> numbered(const std::vector<SeenVehicle>& seen,
                          const std::vector<RoadView>& views) {
  std::vector<int> out(seen.size(), -1);
  int next = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    for (std::size_t j = i; j-- > 0 && out[i] < 0;) {
      if (seen[j].view < seen[i].view && may_be_one(seen[j], seen[i], views)) out[i] = out[j];
    }
    if (out[i] < 0) out[i] = next++;
  }
  return out;
}

/// Of one vehicle by all its views.
struct VehicleMeasurement {
  std::vector<double> losses;  // of each focal length, 0: the likeliest; empty: none
  double log_height = kNone, sigma = kNone, slope = kNone;
  int views = 0;
};

/// @return whether any focal length explains the keypoints.
bool add_losses(const std::vector<double>& costs, double most, std::vector<double>* sum) {
  double least = std::numeric_limits<double>::infinity();
  for (const double c : costs) {
    if (std::isfinite(c)) least = std::min(least, c);
  }
  if (!std::isfinite(least)) return false;
  sum->resize(costs.size(), 0.0);
  for (std::size_t k = 0; k < costs.size(); ++k) {
    (*sum)[k] += std::isfinite(costs[k]) ? std::min(most, costs[k] - least) : most;
  }
  return true;
}

/// m, of a vehicle with the middle one of the focal lengths: without it of the nearest that has an
/// answer, since depths go with them.
double depth_of(const FocalLengthProfile& profile, const std::vector<double>& changes) {
  const auto middle = static_cast<std::ptrdiff_t>(changes.size() / 2);
  for (std::ptrdiff_t off = 0; off <= middle; ++off) {
    for (const std::ptrdiff_t at : {middle - off, middle + off}) {
      const auto k = static_cast<std::size_t>(at);
      if (!std::isfinite(profile.depths[k])) continue;
      return profile.depths[k] * std::exp(changes[static_cast<std::size_t>(middle)] - changes[k]);
    }
  }
  return kNone;
}

std::vector<VehicleMeasurement> measured(const std::vector<SeenVehicle>& seen,
                                         const std::vector<RoadView>& views,
                                         const std::vector<int>& numbers,
                                         const std::vector<double>& changes,
                                         const HypothesisGates& noise) {
  std::vector<VehicleMeasurement> out(
      numbers.empty() ? 0 : *std::max_element(numbers.begin(), numbers.end()) + 1U);
  const std::size_t middle = changes.size() / 2;
  for (std::size_t n = 0; n < out.size(); ++n) {
    VehicleMeasurement& vehicle = out[n];
    std::vector<double> heights, sigmas, slopes;
    int with_losses = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const FocalLengthProfile& p = seen[i].profile;
      if (numbers[i] != static_cast<int>(n)) continue;
      if (!(depth_of(p, changes) < noise.focal_length_farthest)) continue;
      if (add_losses(p.costs, noise.focal_length_most, &vehicle.losses)) ++with_losses;
      const double h = p.heights[middle];
      if (!(h > 0.0) || !(p.height_sigmas[middle] > 0.0)) continue;
      heights.push_back(std::log(h));
      const double bend = bend_of_road(views[seen[i].view]) * p.depths[middle];
      sigmas.push_back(std::hypot(p.height_sigmas[middle], bend) / h);
      const double low = p.heights[middle - 1], high = p.heights[middle + 1];
      if (low > 0.0 && high > 0.0) {
        slopes.push_back(std::log(high / low) / (changes[middle + 1] - changes[middle - 1]));
      }
    }
    for (double& loss : vehicle.losses) loss /= std::max(1, with_losses);
    vehicle.views = static_cast<int>(heights.size());
    if (heights.empty()) continue;
    vehicle.log_height = upper_median(&heights);
    vehicle.sigma = upper_median(&sigmas);
    if (!slopes.empty()) vehicle.slope = upper_median(&slopes);
  }
  return out;
}

/// Where the loss has its minimum, and the mean distance to either side over which it rises by 2,
/// halved: a standard deviation.
struct Minimum {
  double at = 0.0, sigma = 0.0;
};

std::optional<Minimum> minimum_of(const std::vector<double>& at, const std::vector<double>& loss) {
  const auto least =
      static_cast<std::size_t>(std::min_element(loss.begin(), loss.end()) - loss.begin());
  if (least == 0 || least + 1 == loss.size()) return std::nullopt;
  const double step = at[1] - at[0];
  const double rise_low = loss[least - 1] - loss[least], rise_high = loss[least + 1] - loss[least];
  const double bend = rise_low + rise_high;
  if (!(bend > 0.0)) return std::nullopt;
  Minimum out;
  out.at = at[least] + 0.5 * step * (rise_low - rise_high) / bend;
  const double bottom = loss[least] - std::pow(rise_low - rise_high, 2) / (8.0 * bend);
  // Roots of losses are straight lines about a parabola's minimum.
  constexpr double kRise = 2.0, kLeastRise = 0.5;  // two and one standard deviation
  std::vector<double> reaches;
  for (const int side : {-1, 1}) {
    double inner = out.at, inside = 0.0, reach = 0.0;
    for (auto k = static_cast<std::ptrdiff_t>(least) + side;
         k >= 0 && k < static_cast<std::ptrdiff_t>(loss.size()); k += side) {
      const double outer = at[static_cast<std::size_t>(k)];
      const double rise = loss[static_cast<std::size_t>(k)] - bottom;
      const double outside = std::sqrt(std::max(0.0, rise));
      if (rise > kLeastRise) {
        // Beyond this place, where it does not rise so far yet.
        const double from = rise < kRise ? out.at : inner;
        const double root = rise < kRise ? 0.0 : inside;
        reach =
            std::abs(from + (std::sqrt(kRise) - root) / (outside - root) * (outer - from) - out.at);
      }
      if (rise >= kRise) break;
      inner = outer;
      inside = outside;
    }
    if (reach > 0.0) reaches.push_back(reach);
  }
  if (reaches.empty()) return std::nullopt;
  out.sigma = 0.5 * std::accumulate(reaches.begin(), reaches.end(), 0.0) /
              static_cast<double>(reaches.size());
  return out;
}

/// Of the loss of all vehicles.
struct Proportions {
  int vehicles = 0;
  Minimum best;  // change of the focal length's logarithm
};

std::optional<Proportions> proportions_of(const std::vector<VehicleMeasurement>& vehicles,
                                          const std::vector<double>& changes) {
  std::vector<double> total(changes.size(), 0.0);
  Proportions out;
  for (const VehicleMeasurement& vehicle : vehicles) {
    if (vehicle.losses.empty()) continue;
    ++out.vehicles;
    for (std::size_t k = 0; k < total.size(); ++k) total[k] += vehicle.losses[k];
  }
  if (out.vehicles < 2) return std::nullopt;  // one alone may be a van
  const auto best = minimum_of(changes, total);
  if (!best || !(best->sigma > 0.0)) return std::nullopt;
  out.best = *best;
  return out;
}

CameraSource source_of(const Proportions& proportions, const CameraSoFar& so_far,
                       const KnownSizesNoise& noise) {
  CameraSource out;
  out.name = "vehicle_proportions";
  out.phrase = fmt::format("proportions of {} vehicles", proportions.vehicles);
  out.by_focal = 1.0;
  out.value = so_far.log_focal + proportions.best.at;
  out.common = noise.proportions_common;
  out.sigma = std::hypot(noise.proportions_spread * proportions.best.sigma, out.common);
  return out;
}

/// A robust weighted mean (Huber's weights) with the standard deviation that the values' spread
/// lets expect where it is more than stated.
struct WeightedMean {
  double value = 0.0, sigma = 0.0;
};

WeightedMean weighted_mean(const std::vector<double>& values, const std::vector<double>& sigmas) {
  std::vector<double> sorted = values;
  WeightedMean out;
  out.value = upper_median(&sorted);
  constexpr double kWidth = 1.5;
  constexpr int kRounds = 20;
  double information = 0.0, misfit = 0.0;
  for (int round = 0; round < kRounds; ++round) {
    double sum = 0.0;
    information = misfit = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double e = (values[i] - out.value) / sigmas[i];
      const double weight = std::min(1.0, kWidth / std::max(1e-12, std::abs(e)));
      sum += weight * values[i] / (sigmas[i] * sigmas[i]);
      information += weight / (sigmas[i] * sigmas[i]);
      misfit += weight * e * e;
    }
    out.value = sum / information;
  }
  const double freedom = std::max(1.0, static_cast<double>(values.size()) - 1.0);
  out.sigma = std::sqrt(std::max(1.0, misfit / freedom) / information);
  return out;
}

/// @param log_focal  with which the heights are measured.
std::optional<CameraSource> by_sizes(const std::vector<VehicleMeasurement>& vehicles,
                                     double log_focal, const KnownSizesNoise& noise) {
  std::vector<double> heights, sigmas, slopes;
  for (const VehicleMeasurement& vehicle : vehicles) {
    if (!std::isfinite(vehicle.log_height) || !(vehicle.sigma > 0.0)) continue;
    heights.push_back(vehicle.log_height);
    sigmas.push_back(vehicle.sigma);
    if (std::isfinite(vehicle.slope)) slopes.push_back(vehicle.slope);
  }
  if (heights.size() < 2 || slopes.empty()) return std::nullopt;  // one alone may be a van
  const WeightedMean mean = weighted_mean(heights, sigmas);
  CameraSource out;
  out.name = "vehicle_sizes";
  out.phrase = fmt::format("sizes of {} vehicles", heights.size());
  out.by_height = 1.0;
  out.by_focal = -upper_median(&slopes);
  out.value = mean.value + out.by_focal * log_focal;
  out.common = noise.sizes_common;
  out.sigma = std::hypot(mean.sigma, out.common);
  return out;
}

/// The ground of a plane as markings are looked for on it.
GroundRaster raster_of(const PinholeCamera& camera, const Plane& road, const SceneFrame* frame) {
  constexpr double kFarthest = 60.0;  // m
  const auto inverse_depth = [&](int u, int v) {
    return -road.normal.dot(camera.ray({static_cast<double>(u), static_cast<double>(v)})) /
           road.offset;
  };
  GroundRaster out;
  while (out.top < camera.height - 1 &&
         std::max(inverse_depth(0, out.top), inverse_depth(camera.width - 1, out.top)) <
             1.0 / kFarthest) {
    ++out.top;
  }
  const auto rows = static_cast<std::size_t>(camera.height - out.top);
  const auto columns = static_cast<std::size_t>(camera.width);
  out.inverse_depth.resize(rows * columns);
  out.visible.assign(rows * columns, 1);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      out.inverse_depth[r * columns + c] =
          static_cast<float>(inverse_depth(static_cast<int>(c), out.top + static_cast<int>(r)));
    }
  }
  if (!frame) return out;
  for (const VehicleDetection& vehicle : frame->vehicles) {
    const Box2 box = vehicle.box.clipped(camera.width, camera.height);
    for (int v = std::max(out.top, static_cast<int>(box.y1)); v <= static_cast<int>(box.y2); ++v) {
      for (int u = static_cast<int>(box.x1); u <= static_cast<int>(box.x2); ++u) {
        if (u < 0 || u >= camera.width || v < 0 || v >= camera.height) continue;
        out.visible[static_cast<std::size_t>(v - out.top) * columns + static_cast<std::size_t>(u)] =
            0;
      }
    }
  }
  return out;
}

/// A focal length and a height as changes of logarithms.
struct Candidate {
  double focal = 0.0, height = 0.0;
};

std::vector<double> steps_within(double sigma, double step) {
  const int each = static_cast<int>(std::lround(2.0 * sigma / step));
  std::vector<double> out;
  for (int k = -each; k <= each; ++k) out.push_back(k * step);
  return out;
}

struct RatiosOfViews {
  std::vector<double> logs;   // median of each view that has some
  std::vector<double> bends;  // of the height by how the view's road bends, relative

  void add(const std::vector<double>& ratios, double bend) {
    if (ratios.empty()) return;
    std::vector<double> all;
    for (const double r : ratios) all.push_back(std::log(r));
    logs.push_back(upper_median(&all));
    bends.push_back(bend);
  }
};

/// What broken lines of all views are with one focal length and height.
struct BrokenLinesOfDrive {
  int strokes = 0;
  RatiosOfViews periods, widths;
};

std::vector<BrokenLinesOfDrive> look_for_lines(
    const Scene& scene, const std::vector<RoadView>& views,
    const std::function<FrameImage(const RoadView&)>& image, const CameraSoFar& so_far,
    const std::vector<Candidate>& candidates, int num_threads) {
  constexpr double kScaleSigma = 0.05;  // relative, of a height that is tried
  const LaneMarkingSizes sizes = marking_sizes(scene);
  std::vector<BrokenLinesOfDrive> out(candidates.size());
  for (const RoadView& view : views) {
    throw_if_interrupted();
    const FrameImage frame = image(view);
    const GroundRaster ground =
        raster_of(scene.camera, road_in_metres(view, so_far), scene.find_frame(view.frame_id));
    std::vector<BrokenLineRatios> found(candidates.size());
    parallel_for(candidates.size(), num_threads, [&](std::size_t c) {
      const double focal = std::exp(candidates[c].focal), height = std::exp(candidates[c].height);
      PinholeCamera camera = scene.camera;
      camera.fx *= focal;
      camera.fy *= focal;
      GroundRaster stretched = ground;
      const auto by = static_cast<float>(1.0 / (focal * height));
      for (float& rho : stretched.inverse_depth) rho *= by;
      const Eigen::Vector3d ahead(view.ahead.x(), view.ahead.y(), focal * view.ahead.z());
      found[c] = broken_line_ratios(frame.gray, camera, stretched, ahead.normalized(), sizes,
                                    kScaleSigma, 1);
    });
    const double bend = bend_of_road(view) * view.road.depth / view.road.height;
    for (std::size_t c = 0; c < candidates.size(); ++c) {
      out[c].strokes += found[c].strokes;
      out[c].periods.add(found[c].periods, bend);
      out[c].widths.add(found[c].sidewise, bend);
    }
  }
  return out;
}

/// @param sigma  of a view whose road is a plane.
std::optional<WeightedMean> mean_of_views(const RatiosOfViews& ratios, double sigma) {
  constexpr std::size_t kLeast = 2;
  if (ratios.logs.size() < kLeast) return std::nullopt;
  std::vector<double> sigmas;
  for (const double bend : ratios.bends) sigmas.push_back(std::hypot(sigma, bend));
  return weighted_mean(ratios.logs, sigmas);
}

}  // namespace

double bend_of_road(const RoadView& view) {
  return std::asin(std::min(1.0, std::abs(view.road.normal.dot(view.ahead))));
}

std::vector<RoadView> road_views(const std::vector<WindowBundle>& windows,
                                 const std::vector<int>& key_ids, std::size_t most) {
  std::vector<RoadView> all;
  double along = 0.0;
  for (const WindowBundle& bundle : windows) {
    const CalibrationWindow& window = bundle.window();
    const auto road = road_of_window(window);
    const std::vector<TravelStep> steps = travel_steps(window);
    if (!road || steps.empty()) continue;
    std::vector<double> way = {0.0};
    for (std::size_t k = 0; k + 1 < window.frame_from_reference.size(); ++k) {
      way.push_back(way.back() + (window.frame_from_reference[k + 1].inverse().translation() -
                                  window.frame_from_reference[k].inverse().translation())
                                     .norm());
    }
    RoadView view;
    view.frame_id = key_ids.at(window.first + window.reference);
    view.road = *road;
    Eigen::Vector3d ahead = Eigen::Vector3d::Zero();
    for (const TravelStep& step : steps) ahead += step.direction;
    view.ahead = ahead.normalized();
    view.along = along + way.at(window.reference) / road->height;
    along += way.back() / road->height;
    all.push_back(std::move(view));
  }
  if (all.size() <= most) return all;
  std::vector<RoadView> out;
  for (std::size_t k = 0; k < most; ++k) out.push_back(all[k * all.size() / most]);
  return out;
}

void KnownSizesOptions::validate() const {
  if (most_views < 1) throw std::invalid_argument("most_views: 0, must be at least 1");
  if (most_vehicles < 1) throw std::invalid_argument("most_vehicles: 0, must be at least 1");
  fit.validate();
}

std::vector<CameraSource> vehicle_sources(const Scene& scene, const std::vector<RoadView>& views,
                                          const CameraSoFar& so_far,
                                          const KnownSizesOptions& options) {
  options.validate();
  std::vector<SeenVehicle> seen = largest_vehicles(scene, views, so_far, options.most_vehicles);
  const KnownSizesNoise& noise = options.noise;
  SupportOptions support;
  // The distance is measured by the vehicle's size; the plane constrains its attitude alone.
  support.given_sigma_height = noise.free_ground_share * std::exp(so_far.log_height);
  support.given_sigma_tilt = noise.window_road_tilt;
  const std::vector<int> numbers = numbered(seen, views);
  const auto measure = [&](const std::vector<double>& changes) {
    std::vector<double> factors;
    for (const double change : changes) factors.push_back(std::exp(change));
    throw_if_interrupted();
    parallel_for(seen.size(), options.num_threads, [&](std::size_t i) {
      VehicleDetection detection = *seen[i].detection;
      detection.has_plane = true;
      detection.given_plane = road_in_metres(views[seen[i].view], so_far);
      seen[i].profile = focal_length_profile(scene.camera, detection,
                                             given_support(scene.camera, detection, support),
                                             factors, options.fit);
    });
    return measured(seen, views, numbers, changes, options.fit.noise.hypotheses);
  };
  std::vector<double> changes = tried_changes(so_far.focal_sigma);
  std::vector<VehicleMeasurement> vehicles = measure(changes);
  std::optional<Proportions> proportions = proportions_of(vehicles, changes);
  if (proportions && proportions->best.sigma < changes[1] - changes[0]) {
    // The losses are bounded: the likelihood is sampled again about its maximum.
    constexpr double kNarrowest = 0.02;
    const double step = std::max(kNarrowest, proportions->best.sigma);
    const double about = proportions->best.at;
    changes.clear();
    for (int k = -3; k <= 3; ++k) changes.push_back(about + step * k);
    vehicles = measure(changes);
    if (auto finer = proportions_of(vehicles, changes)) proportions = finer;
  }
  std::vector<CameraSource> out;
  if (proportions) out.push_back(source_of(*proportions, so_far, noise));
  const double log_focal = so_far.log_focal + changes[changes.size() / 2];
  if (auto source = by_sizes(vehicles, log_focal, noise)) out.push_back(std::move(*source));
  return out;
}

std::vector<CameraSource> marking_sources(const Scene& scene, const std::vector<RoadView>& views,
                                          const std::function<FrameImage(const RoadView&)>& image,
                                          const CameraSoFar& so_far,
                                          const KnownSizesOptions& options) {
  options.validate();
  if (!marking_sizes(scene).dashes() || views.empty()) return {};
  constexpr double kFocalStep = 0.3, kHeightStep = 0.25;  // lines a fifth off are found
  std::vector<Candidate> candidates;
  for (const double height : steps_within(so_far.height_sigma, kHeightStep)) {
    for (const double focal : steps_within(so_far.focal_sigma, kFocalStep)) {
      candidates.push_back({focal, height});
    }
  }
  const auto unlikely = [&](const Candidate& c) {
    return std::pow(c.focal / so_far.focal_sigma, 2) + std::pow(c.height / so_far.height_sigma, 2);
  };
  std::stable_sort(
      candidates.begin(), candidates.end(),
      [&](const Candidate& a, const Candidate& b) { return unlikely(a) < unlikely(b); });
  const auto look = [&](const std::vector<RoadView>& in, const std::vector<Candidate>& at) {
    return look_for_lines(scene, in, image, so_far, at, options.num_threads);
  };
  constexpr std::size_t kFirstViews = 6;
  const std::size_t first = std::min(kFirstViews, views.size());
  std::vector<RoadView> some;
  for (std::size_t k = 0; k < first; ++k) some.push_back(views[k * views.size() / first]);
  const std::vector<BrokenLinesOfDrive> coarse = look(some, candidates);
  std::size_t best = 0;
  for (std::size_t c = 1; c < coarse.size(); ++c) {
    if (coarse[c].strokes > coarse[best].strokes) best = c;
  }
  const ScaleNoise noise;
  const double of_a_view = options.noise.dashes_of_a_view;
  const auto about = mean_of_views(coarse[best].periods, of_a_view);
  if (!about) return {};
  // Again with what was found: none of the lines is then at the end of what is looked for.
  Candidate at = candidates[best];
  (so_far.focal_sigma > so_far.height_sigma ? at.focal : at.height) -= about->value;
  const BrokenLinesOfDrive lines = look(views, {at}).front();
  const auto periods = mean_of_views(lines.periods, of_a_view);
  if (!periods) return {};
  std::vector<CameraSource> out(1);
  CameraSource& dashes = out.front();
  dashes.name = "dashes";
  dashes.phrase = fmt::format("broken lines of {} frames", lines.periods.logs.size());
  dashes.by_focal = dashes.by_height = 1.0;
  dashes.value = so_far.log_focal + at.focal + so_far.log_height + at.height - periods->value;
  dashes.common = options.noise.dashes_common;
  dashes.sigma = std::hypot(periods->sigma, dashes.common);
  if (const auto widths = mean_of_views(lines.widths, of_a_view)) {
    CameraSource lanes;
    lanes.name = "lane_widths";
    lanes.phrase = fmt::format("lane widths in {} frames", lines.widths.logs.size());
    lanes.by_height = 1.0;
    lanes.value = so_far.log_height + at.height - widths->value;
    lanes.common = noise.painted_lane;
    lanes.sigma = std::hypot(widths->sigma, lanes.common);
    out.push_back(std::move(lanes));
  }
  return out;
}

}  // namespace camber
