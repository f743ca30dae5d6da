#pragma once

#include <string>
#include <utility>

#include "camber/core/progress.h"
#include "camber/core/stopwatch.h"

namespace camber {

/// Runs the stages of a run one after the other: reports where it is, adds up each stage's time,
/// and lets an interruption (a Progress that throws) happen between stages.
class StageRunner {
 public:
  StageRunner(Timings& timings, const Progress& progress)
      : timings_(timings), progress_(progress) {}

  /// @param share  of the whole run that is done before.
  template <class Stage>
  auto operator()(const std::string& name, double share, const Stage& stage) const {
    if (progress_) progress_(name, share);
    const StageTimer timer(timings_, name);
    return stage();
  }

 private:
  Timings& timings_;
  const Progress& progress_;
};

}  // namespace camber
