#pragma once

#include <mutex>
#include <opencv2/core/utility.hpp>

namespace camber {

/// While any of them lives, OpenCV's functions run on one thread: some split their work into as
/// many stripes as there are threads, which changes the result. Calls run side by side instead. The
/// number is one of the process and may not be set while OpenCV computes, so the first sets it and
/// the last sets it back; where it is 1 already (another module's guard) it stays.
class SingleThreadedOpenCv {
 public:
  SingleThreadedOpenCv() {
    State& s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (s.alive++ > 0) return;
    s.before = cv::getNumThreads();
    if (s.before != 1) cv::setNumThreads(1);
  }
  ~SingleThreadedOpenCv() {
    State& s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (--s.alive == 0 && s.before != 1) cv::setNumThreads(s.before);
  }
  SingleThreadedOpenCv(const SingleThreadedOpenCv&) = delete;
  SingleThreadedOpenCv& operator=(const SingleThreadedOpenCv&) = delete;

 private:
  struct State {
    std::mutex mutex;
    int alive = 0, before = 1;
  };
  static State& state() {
    static State the_one;
    return the_one;
  }
};

}  // namespace camber
