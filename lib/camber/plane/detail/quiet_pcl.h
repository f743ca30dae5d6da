#pragma once

namespace camber::detail {

/// While it lives PCL prints nothing: what it would print is in our results.
class QuietPcl {
 public:
  QuietPcl();
  ~QuietPcl();
  QuietPcl(const QuietPcl&) = delete;
  QuietPcl& operator=(const QuietPcl&) = delete;

 private:
  int verbosity_before_;  // a pcl::console::VERBOSITY_LEVEL
};

}  // namespace camber::detail
