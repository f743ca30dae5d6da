#pragma once

#include <opencv2/core/utility.hpp>

namespace camber {

/// While it lives, OpenCV's functions run on one thread: some split their work into as many stripes
/// as there are threads, which changes the result. Calls run side by side instead.
class SingleThreadedOpenCv {
 public:
  SingleThreadedOpenCv() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SingleThreadedOpenCv() { cv::setNumThreads(before_); }
  SingleThreadedOpenCv(const SingleThreadedOpenCv&) = delete;
  SingleThreadedOpenCv& operator=(const SingleThreadedOpenCv&) = delete;

 private:
  int before_;
};

}  // namespace camber
