#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace camber {

/// Wall-clock milliseconds by named stage, in the order in which stages first appear.
class Timings {
 public:
  void add(const std::string& stage, double milliseconds) {
    for (auto& [name, total] : stages_) {
      if (name == stage) {
        total += milliseconds;
        return;
      }
    }
    stages_.emplace_back(stage, milliseconds);
  }
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }

 private:
  std::vector<std::pair<std::string, double>> stages_;
};

/// Adds the time from construction to stop() (or destruction) to one stage.
class StageTimer {
 public:
  StageTimer(Timings& timings, std::string stage)
      : timings_(&timings), stage_(std::move(stage)), start_(Clock::now()) {}
  ~StageTimer() { stop(); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  void stop() {
    if (!timings_) return;
    const std::chrono::duration<double, std::milli> elapsed = Clock::now() - start_;
    timings_->add(stage_, elapsed.count());
    timings_ = nullptr;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Timings* timings_;
  std::string stage_;
  Clock::time_point start_;
};

}  // namespace camber
