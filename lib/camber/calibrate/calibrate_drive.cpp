#include "camber/calibrate/calibrate_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "camber/calibrate/write_calibration.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/image/undistortion.h"
#include "camber/image/video.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

constexpr double kDegrees = 57.29577951308232;
constexpr const char* kGivenHeight = "given_height";

struct WindowPlace {
  std::size_t first = 0, count = 0;
  double turn_px = 0.0;  // median sideways motion of its tracks
};

/// Tracks from each key frame to the next, and their median sideways motion, px.
struct KeySteps {
  std::vector<int> shared;
  std::vector<double> sideways;
};

KeySteps steps_of(const TrackedDrive& drive) {
  const std::size_t steps = drive.key_ids.size() - 1;
  std::vector<std::vector<double>> moved(steps);
  for (const FeatureTrack& track : drive.tracks) {
    for (std::size_t k = 0; k + 1 < track.pixels.size(); ++k) {
      moved[track.first + k].push_back(track.pixels[k + 1].x() - track.pixels[k].x());
    }
  }
  KeySteps out;
  for (std::vector<double>& values : moved) {
    out.shared.push_back(static_cast<int>(values.size()));
    out.sideways.push_back(values.empty() ? 0.0 : upper_median(&values));
  }
  return out;
}

/// Key frames of a window: fewer than asked for where that gives three windows, whose spread shows
/// how well they know the lens.
std::size_t window_length(std::size_t key_frames, const CalibrateOptions& options) {
  constexpr std::size_t kWindows = 3, kLeast = 3;
  const std::size_t enough = (key_frames - 1) / kWindows + 1;
  return std::clamp(enough, kLeast, static_cast<std::size_t>(options.window_frames));
}

/// Windows that follow each other, none over a break of the tracks.
std::vector<WindowPlace> places_of(const TrackedDrive& drive, const CalibrateOptions& options) {
  std::vector<WindowPlace> out;
  if (drive.key_ids.size() < 3) return out;
  const KeySteps steps = steps_of(drive);
  const std::size_t whole = window_length(drive.key_ids.size(), options);
  const int least = options.start.least_points;
  std::size_t begin = 0;
  while (begin + 2 < drive.key_ids.size()) {
    std::size_t end = begin + 1;  // one past the last
    double sideways = 0.0;
    while (end < drive.key_ids.size() && end - begin < whole && steps.shared[end - 1] >= least) {
      sideways += steps.sideways[end - 1];
      ++end;
    }
    if (end - begin >= 3) out.push_back({begin, end - begin, std::abs(sideways)});
    begin = std::max(end - 1, begin + 1);
  }
  return out;
}

/// At most that many windows: half of them with the widest turns, the others spread evenly.
std::vector<WindowPlace> chosen_places(std::vector<WindowPlace> places, std::size_t most) {
  if (places.size() <= most) return places;
  std::vector<std::size_t> order(places.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return places[a].turn_px > places[b].turn_px;
  });
  std::vector<std::size_t> kept(order.begin(),
                                order.begin() + static_cast<std::ptrdiff_t>(most / 2));
  std::vector<std::size_t> rest(order.begin() + static_cast<std::ptrdiff_t>(most / 2), order.end());
  std::sort(rest.begin(), rest.end());
  const std::size_t others = most - most / 2;
  for (std::size_t k = 0; k < others; ++k) kept.push_back(rest[k * rest.size() / others]);
  std::sort(kept.begin(), kept.end());
  std::vector<WindowPlace> out;
  for (const std::size_t i : kept) out.push_back(places[i]);
  return out;
}

std::vector<WindowBundle> start_windows(const DriveLens& lens, const TrackedDrive& drive,
                                        const std::vector<WindowPlace>& places,
                                        const CalibrateOptions& options) {
  std::vector<std::optional<CalibrationWindow>> started(places.size());
  parallel_for(places.size(), options.num_threads, [&](std::size_t i) {
    started[i] = start_window(lens, drive.tracks, places[i].first, places[i].count, options.start);
  });
  std::vector<WindowBundle> out;
  for (auto& window : started) {
    if (window) out.emplace_back(std::move(*window));
  }
  return out;
}

/// Observations within a pixel: how much of the tracks a lens explains.
std::size_t explained(const std::vector<WindowBundle>& windows, const DriveLens& lens) {
  std::size_t out = 0;
  for (const WindowBundle& bundle : windows) {
    for (const Eigen::Vector2d& e : WindowBundle::errors(bundle.window(), lens)) {
      out += e.norm() < 1.0 ? 1 : 0;
    }
  }
  return out;
}

/// A lens that is nearly right: from several focal lengths, over the windows with the widest turns.
std::optional<DriveLens> coarse_lens(const TrackedDrive& drive, std::vector<WindowPlace> places,
                                     const LensPrior& prior, const CalibrateOptions& options) {
  constexpr std::size_t kWindows = 12;
  std::stable_sort(places.begin(), places.end(), [](const WindowPlace& a, const WindowPlace& b) {
    return a.turn_px > b.turn_px;
  });
  places.resize(std::min(places.size(), kWindows));
  LensEstimateOptions rough = options.lens;
  rough.rounds = 0;
  std::optional<DriveLens> best;
  std::size_t most = 0;
  constexpr double kNear = 0.2;  // relative: a start that far off leads to the same lens
  std::vector<double> starts = {0.0};
  if (prior.sigma(0) > kNear) starts.insert(starts.end(), {-prior.sigma(0), prior.sigma(0)});
  for (const double off : starts) {
    DriveLens start = prior.mean;
    start.f *= std::exp(off);
    std::vector<WindowBundle> windows = start_windows(start, drive, places, options);
    if (windows.empty()) continue;
    const LensEstimate estimate = estimate_lens(start, prior, rough, &windows);
    const std::size_t count = explained(windows, estimate.lens);
    if (count > most) {
      most = count;
      best = estimate.lens;
    }
  }
  return best;
}

double turn_of(const CalibrationWindow& window) {
  return rotation_to_vector(window.frame_from_reference.back().rotation() *
                            window.frame_from_reference.front().rotation().inverse())
      .norm();
}

/// What the windows alone measure of the focal length, which the estimate has joined with the
/// prior, against that prior: two normal distributions.
void compare_with_prior(double floor, DriveCalibration* out) {
  DriveLens::Matrix& covariance = out->lens.covariance;
  const double before = std::pow(out->prior.sigma(0), 2);
  const double joined = covariance(0, 0) - floor * floor;
  if (!(joined < 0.99 * before)) return;  // the windows measure nothing
  const double moved = std::log(out->lens.lens.f / out->prior.mean.f);
  const double windows = joined * before / (before - joined) + floor * floor;
  out->focal_surprise = std::pow(moved * before / (before - joined), 2) / (windows + before);
  constexpr double kChance = 6.63;  // chi-square of one freedom, 1 %
  if (out->focal_surprise < kChance) return;
  const double wider = std::sqrt(out->focal_surprise);
  covariance.row(0) *= wider;
  covariance.col(0) *= wider;
  out->notes.push_back(
      fmt::format("the drive shows another focal length than the one that was given, {:.1f} "
                  "standard deviations "
                  "off: its own is stated that much less well known",
                  wider));
}

/// What the windows and their prior know of the focal length.
CameraSource epipolar_source(const DriveCalibration& c, bool given_prior) {
  CameraSource out;
  out.name = "epipolar_geometry";
  out.by_focal = 1.0;
  out.value = std::log(c.lens.lens.f);
  out.sigma = c.lens.sigma(0);
  if (out.sigma > 0.7 * c.prior.sigma(0)) {
    out.phrase = given_prior ? "what was given of it" : "the prior for cars and dash cameras";
  } else {
    out.phrase =
        fmt::format("epipolar geometry of {} windows, which turn by {:.0f} degrees together",
                    c.windows, c.turn * kDegrees);
  }
  return out;
}

/// A wrong focal length stretches the path of the windows, not the height: their quotient, and the
/// product of both.
std::optional<CameraSource> metres_source(const std::vector<WindowBundle>& windows,
                                          const MetresAlong& metres, double log_focal) {
  const auto height = estimate_height(windows, metres, 0.0);
  if (!height || !(height->value > 0.0) || !(height->sigma > 0.0)) return std::nullopt;
  CameraSource out;
  out.name = metres.by_positions ? "positions" : "speeds";
  out.phrase = fmt::format("the {} of the frames", out.name);
  out.by_focal = out.by_height = 1.0;
  out.value = log_focal + std::log(height->value);
  out.sigma = height->sigma / height->value;
  out.common = metres.sigma;
  return out;
}

std::optional<CameraSource> given_height_source(const Scene& scene) {
  if (!scene.height_above_road || !(*scene.height_above_road > 0.0)) return std::nullopt;
  CameraSource out;
  out.name = kGivenHeight;
  out.phrase = fmt::format("the height that is given, {:.2f} m", *scene.height_above_road);
  out.by_height = 1.0;
  out.value = std::log(*scene.height_above_road);
  out.sigma = out.common = scene.height_sigma / *scene.height_above_road;
  return out;
}

/// The lens with another focal length, the other parameters as they go with it.
void put_focal_length(const CameraJoint& joint, LensEstimate* lens) {
  DriveLens::Matrix& covariance = lens->covariance;
  const double before = covariance(0, 0);
  const DriveLens::Vector gain = covariance.col(0) / before;
  const double moved = joint.value(0) - std::log(lens->lens.f);
  lens->lens = lens->lens.with(lens->lens.parameters() + moved * gain);
  covariance += (joint.covariance(0, 0) - before) * gain * gain.transpose();
}

/// Sources that bring at least a tenth of what is known, those that bring most first.
/// @param unknown  0: the focal length, 1: the height.
std::vector<const CameraSource*> deciding_sources(const std::vector<CameraSource>& sources,
                                                  int unknown) {
  constexpr double kLeast = 0.1;
  std::vector<std::pair<double, const CameraSource*>> shares;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    shares.emplace_back(share_of_source(sources, i, unknown), &sources[i]);
  }
  std::stable_sort(shares.begin(), shares.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<const CameraSource*> out;
  for (const auto& [share, source] : shares) {
    if (out.empty() || share > kLeast) out.push_back(source);
  }
  return out;
}

/// The height, where something in the drive measures it.
void put_height(DriveCalibration* out) {
  constexpr double kLeastKnown = 0.15;  // relative: of cars three quarters of that are known before
  out->mounting.height.reset();
  out->mounting.height_by.clear();
  if (out->joint.height_sigma() > kLeastKnown) return;
  std::string names;
  for (const CameraSource* source : deciding_sources(out->sources, 1)) {
    const bool measured = source->by_height != 0.0 && source->name != kGivenHeight &&
                          source->name != height_of_cars().name;
    if (measured) names += (names.empty() ? "" : ", ") + source->name;
  }
  if (names.empty()) return;
  const double height = std::exp(out->joint.value(1));
  out->mounting.height =
      MountingNumber{height, height * out->joint.height_sigma(), static_cast<int>(out->windows)};
  out->mounting.height_by = std::move(names);
}

void describe(DriveCalibration* out) {
  const double known = out->lens.sigma(0);
  out->focal_decided_by.clear();
  for (const CameraSource* source : deciding_sources(out->sources, 0)) {
    out->focal_decided_by += (out->focal_decided_by.empty() ? "" : " and ") + source->phrase;
  }
  for (const CameraSource& source : out->sources) {
    if (source.accepted) continue;
    out->notes.push_back(fmt::format("{}: left out, {}", source.phrase, source.reason));
  }
  if (known > 0.05) {
    out->notes.push_back(fmt::format(
        "the drive hardly turns ({:.0f} degrees over {} windows): the focal length stays at +- "
        "{:.0f} %",
        out->turn * kDegrees, out->windows, 100.0 * known));
  }
  if (out->lens.sigma(3) > 0.7 * out->prior.sigma(3)) {
    out->notes.emplace_back("the lens's distortion is not seen: k1 is the prior's");
  }
}

/// What the tracks show, before it is joined with anything else.
struct Estimated {
  DriveCalibration calibration;
  std::vector<WindowPlace> places;
  std::vector<WindowBundle> windows;
};

Estimated estimate_by_tracks(const TrackedDrive& drive, const CalibrateOptions& options,
                             const Progress& progress) {
  Estimated result;
  DriveCalibration& out = result.calibration;
  const LensPrior cars = lens_prior_of_cars(drive.width, drive.height);
  out.prior = options.prior.value_or(cars);
  out.key_frames = drive.key_ids.size();
  result.places =
      chosen_places(places_of(drive, options), static_cast<std::size_t>(options.most_windows));
  if (result.places.empty()) {
    throw NoAnswerError(fmt::format(
        "{} key frames moved against each other, expected at least 3 that show the same things: "
        "the camera stands, or there is nothing to track",
        out.key_frames));
  }
  const auto coarse = coarse_lens(drive, result.places, out.prior, options);
  const char* const kNoMotion = "no motion of a camera explains what the key frames show";
  if (!coarse) throw NoAnswerError(kNoMotion);
  DriveLens lens = *coarse;
  std::vector<WindowBundle>& windows = result.windows;
  constexpr int kRounds = 3;
  constexpr double kSettled = 0.005;  // of the focal length's logarithm
  for (int round = 0; round < kRounds; ++round) {
    throw_if_interrupted();
    if (progress) progress("lens", 0.8 + 0.04 * round);
    std::vector<WindowBundle> started = start_windows(lens, drive, result.places, options);
    if (started.empty()) break;
    windows = std::move(started);
    out.lens = estimate_lens(lens, out.prior, options.lens, &windows);
    const double change = std::abs(std::log(out.lens.lens.f / lens.f));
    lens = out.lens.lens;
    if (change < kSettled) break;
  }
  if (windows.empty()) throw NoAnswerError(kNoMotion);
  constexpr double kMostContradiction = 11.0;
  if (prior_error(cars, out.lens.lens).squaredNorm() > kMostContradiction) {
    throw NoAnswerError(fmt::format(
        "what {} windows show fits no camera of a car: a focal length of {:.0f} px, the "
        "principal point at {:.0f}, {:.0f} px",
        windows.size(), lens.f, lens.cx, lens.cy));
  }
  out.windows = windows.size();
  if (options.prior) compare_with_prior(options.lens.focal_floor, &out);
  for (const WindowBundle& window : windows) out.turn += turn_of(window.window());
  return result;
}

/// The sources that need no image but the tracks.
std::vector<CameraSource> sources_of_tracks(const TrackedDrive& drive, const Estimated& estimated,
                                            bool given_prior) {
  const DriveCalibration& c = estimated.calibration;
  std::vector<CameraSource> out = {epipolar_source(c, given_prior)};
  if (drive.metres) {
    const double log_focal = std::log(c.lens.lens.f);
    if (auto metres = metres_source(estimated.windows, *drive.metres, log_focal)) {
      out.push_back(std::move(*metres));
    }
  }
  return out;
}

/// Joins the sources, and what follows from the camera that they give.
DriveCalibration joined(const TrackedDrive& drive, const CalibrateOptions& options,
                        std::vector<CameraSource> sources, Estimated estimated) {
  DriveCalibration& out = estimated.calibration;
  sources.push_back(height_of_cars());
  out.sources = std::move(sources);
  out.joint = join_sources(&out.sources);
  const double before = std::log(out.lens.lens.f);
  put_focal_length(out.joint, &out.lens);
  constexpr double kMoved = 0.01;  // from which on the windows are another shape
  if (std::abs(std::log(out.lens.lens.f) - before) > kMoved) {
    std::vector<WindowBundle> again =
        start_windows(out.lens.lens, drive, estimated.places, options);
    if (!again.empty()) {
      constexpr double kHeld = 1e-3;
      const LensPrior held{out.lens.lens, kHeld * out.prior.sigma};
      estimate_lens(out.lens.lens, held, options.lens, &again);
      estimated.windows = std::move(again);
    }
  }
  out.mounting = estimate_mounting(estimated.windows, out.lens.lens, out.lens.covariance);
  put_height(&out);
  describe(&out);
  return std::move(out);
}

CalibrateOptions handed_down(const CalibrateOptions& given) {
  CalibrateOptions out = given;
  out.start.seed = given.seed;
  out.lens.num_threads = out.sizes.num_threads = given.num_threads;
  return out;
}

/// What has known sizes in the frames that see the road.
std::vector<CameraSource> sources_of_sizes(const Scene& scene, const TrackedDrive& drive,
                                           const CalibrateOptions& options,
                                           const Estimated& estimated,
                                           const std::vector<CameraSource>& known,
                                           const FramePixelSource& pixels) {
  std::vector<CameraSource> so_far = known;
  so_far.push_back(height_of_cars());
  const CameraJoint joint = join_sources(&so_far);
  if (!(joint.focal_sigma() > options.sizes_from)) return {};
  const std::vector<RoadView> views =
      road_views(estimated.windows, drive.key_ids, options.sizes.most_views);
  if (views.empty()) return {};
  Scene calibrated = calibrated_scene(scene, estimated.calibration);
  const double log_focal = std::log(estimated.calibration.lens.lens.f);
  const CameraSoFar camera{log_focal, joint.focal_sigma(), joint.value(1), joint.height_sigma()};
  std::vector<int> ids;
  for (const RoadView& view : views) ids.push_back(view.frame_id);
  if (options.find_vehicles) options.find_vehicles(ids, &calibrated);
  KnownSizesOptions sizes = options.sizes;
  if (calibrated.box_sigma_px) sizes.fit.noise.box.pixel_sigma = *calibrated.box_sigma_px;
  std::vector<CameraSource> out = vehicle_sources(calibrated, views, camera, sizes);
  const Undistortion lens(calibrated.camera, calibrated.distortion);
  FrameImageReader reader;
  const auto image = [&](const RoadView& view) {
    Image held = pixels ? pixels(view.frame_id).image : Image();
    return held.empty() ? reader.read(calibrated.find_frame(view.frame_id)->image, lens)
                        : make_frame_image(std::move(held), lens, view.frame_id);
  };
  for (CameraSource& source : marking_sources(calibrated, views, image, camera, sizes)) {
    out.push_back(std::move(source));
  }
  return out;
}

}  // namespace

void CalibrateOptions::validate() const {
  tracks.validate();
  const auto check = [](bool good, const char* name) {
    if (!good) throw std::invalid_argument(std::string(name) + " is out of its range");
  };
  check(window_frames >= 3 && window_frames <= 16, "window_frames");
  check(most_windows >= 4, "most_windows");
  check(start.inlier_px > 0.0, "start.inlier_px");
  check(start.least_points >= 8, "start.least_points");
  check(lens.correlation >= 1.0, "lens.correlation");
  check(lens.trim > 0.0, "lens.trim");
  check(sizes_from >= 0.0, "sizes_from");
  sizes.validate();
}

TrackedDrive track_drive(const Scene& scene, const std::vector<int>& ids,
                         const CalibrateOptions& options, const FramePixelSource& pixels,
                         const Progress& progress) {
  FeatureTracker tracker(options.tracks);
  FrameImageReader reader;
  const PinholeCamera& files = file_camera(scene);
  const Undistortion as_it_is(files);
  TrackedDrive out;
  out.width = files.width;
  out.height = files.height;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    throw_if_interrupted();
    if (progress) {
      progress("tracks", 0.7 * static_cast<double>(i) / static_cast<double>(ids.size()));
    }
    Image held = pixels ? pixels(ids[i]).image : Image();
    FrameImage read;
    try {
      read = held.empty() ? reader.read(scene.find_frame(ids[i])->image, files)
                          : make_frame_image(std::move(held), as_it_is, ids[i]);
    } catch (const InputError&) {
      if (!options.skip_unreadable) throw;
      continue;
    }
    if (tracker.add(read.gray)) out.key_ids.push_back(ids[i]);
  }
  out.tracks = tracker.take();
  out.metres = metres_by_speed(scene, out.key_ids);
  if (!out.metres) out.metres = metres_by_positions(scene, out.key_ids);
  return out;
}

std::optional<MountingNumber> height_by(const DriveCalibration& c, const std::string& name) {
  for (const CameraSource& source : c.sources) {
    if (source.name != name || !source.accepted || source.by_height == 0.0) continue;
    const double height =
        std::exp((source.value - source.by_focal * c.joint.value(0)) / source.by_height);
    const double sigma = std::hypot(source.sigma, source.by_focal * c.joint.focal_sigma());
    return MountingNumber{height, height * sigma / std::abs(source.by_height),
                          static_cast<int>(c.windows)};
  }
  return std::nullopt;
}

DriveCalibration calibrate_tracks(const TrackedDrive& drive, const CalibrateOptions& given,
                                  const Progress& progress) {
  given.validate();
  const CalibrateOptions options = handed_down(given);
  Timings timings;
  StageTimer timer(timings, "motion");
  Estimated estimated = estimate_by_tracks(drive, options, progress);
  std::vector<CameraSource> sources =
      sources_of_tracks(drive, estimated, options.prior.has_value());
  DriveCalibration out = joined(drive, options, std::move(sources), std::move(estimated));
  timer.stop();
  out.timings = std::move(timings);
  return out;
}

DriveCalibration calibrate_drive(const Scene& scene, const std::vector<int>& frame_ids,
                                 const CalibrateOptions& given, const FramePixelSource& pixels,
                                 const Progress& progress) {
  given.validate();
  const CalibrateOptions options = handed_down(given);
  Timings timings;
  StageTimer tracking(timings, "correspondences");
  const TrackedDrive drive = track_drive(scene, frame_ids, options, pixels, progress);
  tracking.stop();
  if (progress) progress("lens", 0.7);
  StageTimer motion(timings, "motion");
  Estimated estimated = estimate_by_tracks(drive, options, progress);
  motion.stop();
  if (progress) progress("known sizes", 0.92);
  StageTimer scale(timings, "scale");
  std::vector<CameraSource> sources =
      sources_of_tracks(drive, estimated, options.prior.has_value());
  if (auto height = given_height_source(scene)) sources.push_back(std::move(*height));
  for (CameraSource& source : sources_of_sizes(scene, drive, options, estimated, sources, pixels)) {
    sources.push_back(std::move(source));
  }
  DriveCalibration out = joined(drive, options, std::move(sources), std::move(estimated));
  scale.stop();
  out.frames = frame_ids.size();
  out.timings = std::move(timings);
  return out;
}

}  // namespace camber
