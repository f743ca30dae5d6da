#include "motion/simulated_matches.h"

#include <limits>

#include "camber/core/random.h"

namespace camber::test {

SimulatedMatches simulate_matches(const PinholeCamera& camera,
                                  const std::vector<SE3>& frame_from_reference, int reference,
                                  const SimulatedMatchesOptions& options) {
  SimulatedMatches out;
  Correspondences& m = out.matches;
  m.reference = reference;
  m.step = options.step;
  m.columns = (camera.width - 1) / options.step + 1;
  m.rows = (camera.height - 1) / options.step + 1;
  const CounterRandom depth(options.seed, 1), wrong(options.seed, 2), texture(options.seed, 3);
  const auto count = static_cast<std::size_t>(m.columns) * static_cast<std::size_t>(m.rows);
  for (std::size_t i = 0; i < count; ++i) {
    m.pixels.emplace_back(static_cast<float>(static_cast<int>(i) % m.columns * options.step),
                          static_cast<float>(static_cast<int>(i) / m.columns * options.step));
    out.depths.push_back(depth.uniform(i, options.nearest, options.farthest));
    out.outlier.push_back(wrong.uniform(i) < options.outliers ? 1 : 0);
    // Strong enough that a match errs by the simulated noise alone.
    const auto strength = static_cast<float>(texture.uniform(i, 1000.0, 3000.0));
    m.texture.emplace_back(strength, 0.0f, strength);
  }
  out.all.assign(count, 1);
  for (std::size_t f = 0; f < frame_from_reference.size(); ++f) {
    if (static_cast<int>(f) == reference) continue;
    MatchedImage match;
    match.frame = static_cast<int>(f);
    match.pixels.resize(count);
    match.round_trip_px.assign(count, std::numeric_limits<float>::infinity());
    const CounterRandom noise(options.seed, 100 + f), gross(options.seed, 200 + f);
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d x = out.depths[i] * camera.ray(m.pixels[i].cast<double>());
      const auto p = camera.project(frame_from_reference[f] * x);
      if (!p) continue;
      Eigen::Vector2d seen =
          *p + options.noise_px * Eigen::Vector2d(noise.normal(2 * i), noise.normal(2 * i + 1));
      if (out.outlier[i]) {
        seen += Eigen::Vector2d(gross.uniform(2 * i, -30, 30), gross.uniform(2 * i + 1, -30, 30));
      }
      if (!camera.contains(seen)) continue;
      match.pixels[i] = seen.cast<float>();
      match.round_trip_px[i] = 0.0f;
    }
    m.matches.push_back(std::move(match));
  }
  return out;
}

PinholeCamera small_camera() { return {640, 240, 400.0, 400.0, 320.0, 110.0}; }

std::vector<SE3> driving_motion() {
  return {SE3(rotation_from_vector({0.004, -0.015, 0.002}), {0.03, -0.04, 0.90}), SE3(),
          SE3(rotation_from_vector({-0.003, 0.018, -0.001}), {-0.02, 0.03, -1.10})};
}

}  // namespace camber::test
