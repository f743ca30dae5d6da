#include "camber/scene/travelled.h"

#include <cmath>
#include <vector>

#include "camber/scale/speed_noise.h"

namespace camber {

std::optional<double> travelled_between(const Scene& scene, int from, int to, double frame_rate,
                                        SpeedWeights* weights) {
  const SceneFrame* before = nullptr;
  double metres = 0.0;
  SpeedWeights own;
  for (const SceneFrame& frame : scene.frames) {
    if (frame.id < from || frame.id > to || !frame.speed) continue;
    if (!before && frame.id != from) return std::nullopt;
    if (before) {
      const double span = time_of(frame, frame_rate) - time_of(*before, frame_rate);
      if (!(span > 0.0)) return std::nullopt;
      metres += 0.5 * span * (*before->speed + *frame.speed);
      own[before->id] += 0.5 * span;
      own[frame.id] += 0.5 * span;
    }
    before = &frame;
  }
  if (!before || before->id != to || own.empty()) return std::nullopt;
  for (const auto& [id, weight] : own) (*weights)[id] += weight;
  return metres;
}

DistanceSigma travelled_sigma(const Scene& scene, double frame_rate, const SpeedWeights& weights) {
  std::vector<TimedSpeed> samples;
  double sum = 0.0, squares = 0.0;
  for (const SceneFrame& frame : scene.frames) {
    if (!frame.speed || !(frame.speed_sigma > 0.0)) continue;
    const double time = time_of(frame, frame_rate);
    if (samples.empty() || time > samples.back().time_s) {
      samples.push_back({time, *frame.speed, frame.speed_sigma});
    }
    const auto weight = weights.find(frame.id);
    if (weight == weights.end()) continue;
    const double sigma = weight->second * frame.speed_sigma;
    sum += sigma;
    squares += sigma * sigma;
  }
  const SpeedNoise noise = speed_noise(samples);
  return {std::sqrt(noise.independent * squares), std::sqrt(noise.common) * sum};
}

}  // namespace camber
