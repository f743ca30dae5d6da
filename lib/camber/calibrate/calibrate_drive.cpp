#include "camber/calibrate/calibrate_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/image/video.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

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

/// The height that the scene states against the one by its speeds or positions.
void compare_heights(const Scene& scene, DriveCalibration* out) {
  const auto& seen = out->mounting.height;
  if (!seen || !scene.height_above_road) return;
  const double off = *scene.height_above_road - seen->value;
  const double sigma = std::hypot(scene.height_sigma, seen->sigma);
  constexpr double kChance = 6.63;  // chi-square of one freedom, 1 %
  if (off * off < kChance * sigma * sigma) return;
  out->notes.push_back(fmt::format(
      "the scene's height, {:.2f} +- {:.2f} m, and the one by its {} contradict each other, "
      "{:.1f} standard deviations",
      *scene.height_above_road, scene.height_sigma,
      out->mounting.height_by_positions ? "positions" : "speeds", std::abs(off) / sigma));
}

void describe(bool given_prior, DriveCalibration* out) {
  const double known = out->lens.sigma(0), prior = out->prior.sigma(0);
  const double turn_deg = out->turn * 57.29577951308232;
  if (known > 0.7 * prior) {
    out->focal_decided_by =
        given_prior ? "what was given of it" : "the prior for cars and dash cameras";
  } else {
    out->focal_decided_by =
        fmt::format("epipolar geometry of {} windows, which turn by {:.0f} degrees together",
                    out->windows, turn_deg);
  }
  if (known > 0.05) {
    out->notes.push_back(fmt::format(
        "the drive hardly turns ({:.0f} degrees over {} windows): the focal length stays at +- "
        "{:.0f} %",
        turn_deg, out->windows, 100.0 * known));
  }
  if (out->lens.sigma(3) > 0.7 * out->prior.sigma(3)) {
    out->notes.emplace_back("the lens's distortion is not seen: k1 is the prior's");
  }
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

DriveCalibration calibrate_tracks(const TrackedDrive& drive, const CalibrateOptions& given,
                                  const Progress& progress) {
  given.validate();
  CalibrateOptions options = given;
  options.start.seed = given.seed;
  options.lens.num_threads = given.num_threads;
  DriveCalibration out;
  const LensPrior cars = lens_prior_of_cars(drive.width, drive.height);
  out.prior = options.prior.value_or(cars);
  out.key_frames = drive.key_ids.size();
  const std::vector<WindowPlace> places =
      chosen_places(places_of(drive, options), static_cast<std::size_t>(options.most_windows));
  if (places.empty()) {
    throw NoAnswerError(fmt::format(
        "{} key frames moved against each other, expected at least 3 that show the same things: "
        "the camera stands, or there is nothing to track",
        out.key_frames));
  }
  StageTimer timer(out.timings, "motion");
  const auto coarse = coarse_lens(drive, places, out.prior, options);
  const char* const kNoMotion = "no motion of a camera explains what the key frames show";
  if (!coarse) throw NoAnswerError(kNoMotion);
  DriveLens lens = *coarse;
  std::vector<WindowBundle> windows;
  constexpr int kRounds = 3;
  constexpr double kSettled = 0.005;  // of the focal length's logarithm
  for (int round = 0; round < kRounds; ++round) {
    throw_if_interrupted();
    if (progress) progress("lens", 0.8 + 0.06 * round);
    std::vector<WindowBundle> started = start_windows(lens, drive, places, options);
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
  out.mounting = estimate_mounting(windows, out.lens.lens, out.lens.covariance);
  if (drive.metres) {
    out.mounting.height = estimate_height(windows, *drive.metres, out.lens.sigma(0));
    out.mounting.height_by_positions = out.mounting.height && drive.metres->by_positions;
  }
  describe(options.prior.has_value(), &out);
  timer.stop();
  return out;
}

DriveCalibration calibrate_drive(const Scene& scene, const std::vector<int>& frame_ids,
                                 const CalibrateOptions& options, const FramePixelSource& pixels,
                                 const Progress& progress) {
  options.validate();
  Timings timings;
  StageTimer tracking(timings, "correspondences");
  const TrackedDrive drive = track_drive(scene, frame_ids, options, pixels, progress);
  tracking.stop();
  if (progress) progress("lens", 0.7);
  DriveCalibration out = calibrate_tracks(drive, options, progress);
  compare_heights(scene, &out);
  out.frames = frame_ids.size();
  for (const auto& [stage, ms] : out.timings.stages()) timings.add(stage, ms);
  out.timings = std::move(timings);
  return out;
}

}  // namespace camber
