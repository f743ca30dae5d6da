#include "camber/drive/measure_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/threads.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/stage_runner.h"

namespace camber {
namespace {

using stages::LoadedFrame;
using FramePtr = std::shared_ptr<const LoadedFrame>;

constexpr std::size_t kAhead = 8;  // frames that are looked at before their turn

/// The last frames that were read. Two threads may ask.
class FrameCache {
 public:
  FrameCache(const Scene& scene, const stages::LoadOptions& options) : loader_(scene, options) {}

  FramePtr get(int id) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const FramePtr& frame : held_) {
      if (frame->frame.id == id) return frame;
    }
    held_.push_back(loader_.load(id));
    if (held_.size() > kHeld) held_.erase(held_.begin());
    return held_.back();
  }

 private:
  static constexpr std::size_t kHeld = 12 + kAhead;
  std::mutex mutex_;
  stages::FrameLoader loader_;
  std::vector<FramePtr> held_;
};

/// Looks at one frame after the other, some ahead, on a thread of its own.
class LookAhead {
 public:
  /// @param look   of a place among the frames; called in order, on one thread.
  /// @param aside  false: no other thread, each frame is looked at when it is asked for.
  LookAhead(std::function<FrameRecord(std::size_t)> look, std::size_t first, std::size_t end,
            bool aside)
      : look_(std::move(look)), next_(first), end_(end) {
    if (aside) thread_ = std::thread([this] { run(); });
  }
  ~LookAhead() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
  }
  LookAhead(const LookAhead&) = delete;
  LookAhead& operator=(const LookAhead&) = delete;

  /// @throws what looking at the frame did.
  FrameRecord next() {
    if (!thread_.joinable()) return look_(next_++);
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [&] { return !seen_.empty() || failure_; });
    if (seen_.empty()) std::rethrow_exception(failure_);
    FrameRecord out = std::move(seen_.front());
    seen_.pop_front();
    changed_.notify_all();
    return out;
  }

 private:
  void run() {
    for (; next_ < end_; ++next_) {
      {
        std::unique_lock<std::mutex> lock(mutex_);
        changed_.wait(lock, [&] { return stopped_ || seen_.size() < kAhead; });
        if (stopped_) return;
      }
      std::optional<FrameRecord> record;
      std::exception_ptr failure;
      try {
        record = look_(next_);
      } catch (...) {
        failure = std::current_exception();
      }
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (record) seen_.push_back(std::move(*record));
        failure_ = failure;
      }
      changed_.notify_all();
      if (failure) return;
    }
  }

  std::function<FrameRecord(std::size_t)> look_;
  std::size_t next_, end_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<FrameRecord> seen_;
  std::exception_ptr failure_;
  bool stopped_ = false;
  std::thread thread_;
};

/// Reads a drive frame by frame and measures its windows.
class Measurer {
 public:
  Measurer(const Scene& scene, const std::vector<int>& ids, const DriveOptions& options,
           WindowLog* log, Timings* timings, const Progress& progress)
      : scene_(scene),
        ids_(ids),
        options_(options),
        window_options_(options.window),
        log_(*log),
        timings_(*timings),
        progress_(progress),
        at_once_(std::min(kMostAtOnce, resolve_num_threads(options.window.num_threads))),
        cache_(scene, handed_down(options.window).load) {
    window_options_.match.kept = &flows_;
    window_options_.match.smooth_start = false;
    window_options_.sweep_road = true;
    window_options_.num_threads =
        std::max(1, resolve_num_threads(options.window.num_threads) / at_once_);
    window_options_ = handed_down(window_options_);
    vehicle_options_ = window_options_;
    vehicle_options_.rounds = std::min(kQuickRounds, vehicle_options_.rounds);
    road_options_ = vehicle_options_;
    road_options_.photometric = false;
  }

  void run() {
    const SingleThreadedOpenCv guard;  // frames are read while windows are measured
    measure_all();
    for (const auto& [stage, ms] : look_timings_.stages()) timings_.add(stage, ms);
  }

 private:
  void measure_all() {
    std::optional<LookAhead> ahead;
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (progress_ && i >= log_.frames().size()) {
        progress_("windows",
                  kWindowsShare * static_cast<double>(i) / static_cast<double>(ids_.size()));
      }
      throw_if_interrupted();
      const bool known = i < log_.frames().size();
      if (!known && !ahead) {
        see_again();
        ahead.emplace([this](std::size_t at) { return look_at(ids_[at]); }, i, ids_.size(),
                      resolve_num_threads(options_.window.num_threads) > 1);
      }
      const FrameRecord record = known ? log_.frames()[i] : ahead->next();
      if (!known) log_.append(record);
      if (record.kind == FrameRecord::Kind::kKey) {
        keys_.push_back(record.frame);
        measure_between(keys_.size() - 2);
        between_.clear();
        const auto side = static_cast<std::size_t>(options_.each_side);
        if (keys_.size() > side) measure(keys_.size() - 1 - side);
      } else if (record.kind == FrameRecord::Kind::kBetween) {
        between_.push_back(record.frame);
      }
    }
    const auto side = static_cast<std::size_t>(options_.each_side);
    for (std::size_t k = keys_.size() > side ? keys_.size() - side : 0; k < keys_.size(); ++k) {
      measure(k);
    }
    measure_after_the_last_key();
    measure_pending();
    measure_beside_those_without_metres();
    measure_pending();
  }

  FrameRecord look_at(int id) {
    FramePtr frame;
    try {
      const StageTimer timer(look_timings_, "load");
      frame = cache_.get(id);
    } catch (const InputError& error) {
      return {id, FrameRecord::Kind::kUnreadable, error.what()};
    } catch (const NoAnswerError& error) {
      return {id, FrameRecord::Kind::kUnreadable, error.what()};
    }
    if (last_ && last_->gray.pixels == frame->gray.pixels) {
      return {id, FrameRecord::Kind::kRepeated,
              fmt::format("the picture of frame {}", last_->frame.id)};
    }
    const StageTimer timer(look_timings_, "correspondences");
    bool still = false;
    const bool key = !last_key_ || is_key(frame, &still);
    still = still && last_ && follows(last_->frame.id, id);
    see(frame, key);
    return {id, key ? FrameRecord::Kind::kKey : FrameRecord::Kind::kBetween, "", still};
  }

  /// Whether a frame has parallax to the last key frame. What is near may stand still in the
  /// picture (a bonnet, asphalt that a film's coder repeats), and what moves fast is lost over
  /// several frames: so the motion from frame to frame counts, too.
  /// @param still  nothing below the horizon moves from the frame before.
  bool is_key(const FramePtr& frame, bool* still) {
    const double enough = kEnoughNearParallax * scene_.camera.fx;
    const GrayImage small = shrunk(frame->gray);
    const ImageParallax to_key =
        image_parallax(scene_.camera, shrunk(last_key_->gray), small, kLeastNearMatched, 1);
    if (!to_key.near || *to_key.near >= enough) return true;
    const ImageParallax step =
        last_ == last_key_
            ? to_key
            : image_parallax(scene_.camera, shrunk(last_->gray), small, kLeastNearMatched, 1);
    if (step.most > kLeastStep) moved_ += step.most;
    *still = step.near && *step.near < kStillNear && step.most < kStillMost && has_contrast(small);
    return moved_ >= kEnoughMoved * enough;
  }

  bool follows(int before, int id) const {
    const auto at = std::lower_bound(ids_.begin(), ids_.end(), id);
    return at != ids_.begin() && *std::prev(at) == before;
  }

  /// Black and blinded pictures do not show that nothing moves.
  static bool has_contrast(const GrayImage& image) {
    const std::size_t from = image.pixels.size() / 2;  // below the middle
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = from; i < image.pixels.size(); ++i) {
      const double value = image.pixels[i];
      sum += value;
      squares += value * value;
    }
    const auto count = static_cast<double>(image.pixels.size() - from);
    return squares / count - std::pow(sum / count, 2) > kLeastContrast * kLeastContrast;
  }

  void see(const FramePtr& frame, bool key) {
    last_ = frame;
    if (!key) return;
    last_key_ = frame;
    moved_ = 0.0;
  }

  /// After an interruption: the last key frame and those since.
  void see_again() {
    if (keys_.empty()) return;
    see(cache_.get(keys_.back()), true);
    for (const int id : between_) {
      const FramePtr frame = cache_.get(id);
      bool still = false;
      is_key(frame, &still);
      see(frame, false);
    }
  }

  bool has_vehicles(int id) const { return !scene_.find_frame(id)->vehicles.empty(); }

  std::vector<FramePtr> frames_of(const std::vector<int>& ids) {
    const StageTimer timer(timings_, "load");
    std::vector<FramePtr> out;
    for (const int id : ids) out.push_back(cache_.get(id));
    return out;
  }

  std::size_t every() const {
    return static_cast<std::size_t>(std::min(options_.every, 2 * options_.each_side - 1));
  }

  void measure(std::size_t key) {
    if (key % every() == 0) measure_about(key);
  }

  /// Where a window does not measure the scale, those about the key frames beside it may.
  void measure_beside_those_without_metres() {
    std::set<int> without;
    log_.for_each_window([&](const WindowMeasurement& w) {
      const bool known = w.log_scale && w.scale_sigma <= options_.noise.weakest_scale;
      if (!known) without.insert(w.reference);
    });
    for (std::size_t key = 0; key < keys_.size(); key += every()) {
      if (without.count(keys_[key]) == 0) continue;
      if (key > 0) measure_about(key - 1, false);
      if (key + 1 < keys_.size()) measure_about(key + 1, false);
    }
  }

  /// The window about a key frame.
  /// @param again  by all rounds where one measures the scale badly.
  void measure_about(std::size_t key, bool again = true) {
    const int reference = keys_[key];
    if (log_.has_window(reference)) return;
    const auto side = static_cast<std::size_t>(options_.each_side);
    const std::size_t first = key > side ? key - side : 0;
    const std::size_t last = std::min(keys_.size() - 1, key + side);
    if (first == last) return;  // one frame has no motion
    const std::vector<int> ids(keys_.begin() + static_cast<std::ptrdiff_t>(first),
                               keys_.begin() + static_cast<std::ptrdiff_t>(last) + 1);
    pend({frames_of(ids), key - first, true, again});
  }

  /// Windows are measured side by side, and written down in their order.
  struct PendingWindow {
    std::vector<FramePtr> frames;
    std::size_t reference = 0;
    bool whole = true;  // false: the motion alone
    bool again = true;
  };

  /// By one round of matches; once more by all rounds where that measures the scale badly
  /// (docs/notes/drives.md). Intensities are for the road under vehicles.
  WindowMeasurement measured(const PendingWindow& w, Timings* timings) const {
    const auto by = [&](const ReconstructOptions& options) {
      return measure_window(scene_, w.frames, w.reference, options, options_.samples, timings);
    };
    const bool vehicles = std::any_of(w.frames.begin(), w.frames.end(), [](const FramePtr& frame) {
      return !frame->frame.vehicles.empty();
    });
    WindowMeasurement quick = by(vehicles ? vehicle_options_ : road_options_);
    const bool sure = quick.log_scale && quick.scale_sigma <= kSureScale;
    return sure || !w.again ? quick : by(window_options_);
  }

  void pend(PendingWindow window) {
    pending_.push_back(std::move(window));
    if (pending_.size() >= static_cast<std::size_t>(at_once_)) measure_pending();
  }

  void measure_pending() {
    int oldest = std::numeric_limits<int>::max();
    for (const PendingWindow& w : pending_) {
      oldest = std::min(oldest, w.frames.front()->frame.id);
    }
    flows_.forget_before(oldest);
    std::vector<WindowMeasurement> measured(pending_.size());
    std::vector<Timings> timings(pending_.size());
    parallel_for(pending_.size(), at_once_, [&](std::size_t i) {
      const PendingWindow& w = pending_[i];
      measured[i] =
          w.whole ? this->measured(w, &timings[i])
                  : measure_motion(scene_, w.frames, w.reference, window_options_, &timings[i]);
    });
    for (std::size_t i = 0; i < measured.size(); ++i) {
      log_.append(measured[i]);
      for (const auto& [stage, ms] : timings[i].stages()) timings_.add(stage, ms);
    }
    log_.flush();
    pending_.clear();
  }

  /// Frames between a key frame and the next.
  void measure_between(std::size_t key) {
    if (keys_.size() < 2) return;
    for (const int id : between_) measure_beside(id, {keys_[key], id, keys_[key + 1]}, 1);
  }

  void measure_after_the_last_key() {
    if (keys_.empty()) return;
    for (const int id : between_) {
      if (keys_.size() > 1) {
        measure_beside(id, {keys_[keys_.size() - 2], keys_.back(), id}, 2);
      } else {
        measure_beside(id, {keys_.back(), id}, 1);
      }
    }
    between_.clear();
  }

  void measure_beside(int id, const std::vector<int>& ids, std::size_t reference) {
    if (log_.has_window(id)) return;
    pend({frames_of(ids), reference, has_vehicles(id)});
  }

  const Scene& scene_;
  const std::vector<int>& ids_;
  const DriveOptions& options_;
  ReconstructOptions window_options_, vehicle_options_, road_options_;
  WindowLog& log_;
  Timings& timings_;
  const Progress& progress_;
  static constexpr int kMostAtOnce = 4;
  static constexpr int kQuickRounds = 1;
  static constexpr double kSureScale = 0.05;  // of a window's own
  // px: a step of 3 mm at most, of pictures that differ by their noise (docs/notes/drives.md)
  static constexpr double kStillNear = 0.25, kStillMost = 0.4;
  static constexpr double kLeastContrast = 8.0;  // grey levels
  int at_once_;                                  // windows
  std::vector<PendingWindow> pending_;
  FrameCache cache_;
  FlowCache flows_;
  std::vector<int> keys_, between_;
  // Of what looks at frames:
  FramePtr last_, last_key_;
  double moved_ = 0.0;  // px, since the last key frame
  Timings look_timings_;
};

}  // namespace

void measure_drive(const Scene& scene, const std::vector<int>& frame_ids,
                   const DriveOptions& options, WindowLog* log, Timings* timings,
                   const Progress& progress) {
  Measurer(scene, frame_ids, options, log, timings, progress).run();
}

}  // namespace camber
