#include "camber/plane/detail/cloud_passes.h"

#include <algorithm>
#include <cmath>

#include "camber/core/threads.h"

namespace camber::detail {

namespace kernels = plane_kernels;

namespace {

constexpr std::size_t kCounted = 131072;  // points that decide between competitors
constexpr double kCountSigmas = 4.0;      // within which they count: few that belong are left out

}  // namespace

double count_support(const PointColumns& source, const std::array<float, 3>& pivot,
                     const PlaneCandidate& c) {
  const std::size_t blocks = (source.size + kernels::kBlock - 1) / kernels::kBlock;
  const std::size_t most = kCounted / kernels::kBlock;
  const std::size_t step = std::max<std::size_t>(1, blocks / most);
  alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
      weight[kernels::kBlock];
  kernels::Window window = c.window.as_float();
  // Its edges, sharp.
  window.half_u *= 0.5f / 0.48f;
  window.half_v *= 0.5f / 0.48f;
  window.ramp_u *= 1e-3f;
  window.ramp_v *= 1e-3f;
  const kernels::Target target = {c.plane.as_float(), window,
                                  static_cast<float>(kCountSigmas * kCountSigmas)};
  double count = 0.0;
  for (std::size_t block = 0; block < blocks; block += step) {
    const std::size_t begin = block * kernels::kBlock;
    const std::size_t m = std::min(kernels::kBlock, source.size - begin);
    const std::size_t first = source.stride * begin;
    kernels::load_points({source.x + first, source.y + first, source.z + first, source.stride, m},
                         pivot.data(), 1.0f, {x, y, z, weight});
    for (std::size_t k = m; k < kernels::padded(m); ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
    c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z, source.sigma ? source.sigma + begin : nullptr,
                  source.covariance ? source.covariance + begin : nullptr, weight);
    kernels::Moments moments;
    kernels::accumulate({x, y, z, weight, kernels::padded(m)}, target, kernels::Loss::kReweighted,
                        false, &moments);
    count += moments.count;
  }
  return count;
}

void load_many(const PointColumns& source, const std::array<float, 3>& pivot, PointArrays* many) {
  constexpr std::size_t kMost = 65536;
  const std::size_t every = (source.size + kMost - 1) / kMost;
  const std::size_t n = (source.size + every - 1) / every;
  PointArrays& s = *many;
  s.resize(n, source.sigma != nullptr, source.covariance != nullptr);
  kernels::load_points({source.x, source.y, source.z, source.stride * every, n}, pivot.data(), 1.0f,
                       {s.x.data(), s.y.data(), s.z.data(), s.w.data()});
  for (std::size_t k = 0; k < n; ++k) {
    // Far from everything, so that no plane holds those that are not usable.
    if (!(s.w[k] > 0.0f)) s.x[k] = s.y[k] = s.z[k] = 1e15f;
    if (source.sigma) s.sigma[k] = source.sigma[every * k];
    if (source.covariance) s.covariance[k] = source.covariance[every * k];
  }
}

CloudMoments sum_cloud_moments(const PointColumns& source, const std::array<float, 3>& pivot,
                               const PlaneCandidate& c, bool finish, bool list,
                               double expected_share, int num_threads) {
  const std::size_t n = source.size;
  // Chunks of whole blocks: sums are added in chunk order, whoever computed them.
  constexpr std::size_t kChunk = 32 * kernels::kBlock;
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  struct Part {
    kernels::Moments moments;
    std::vector<int> inliers;
  };
  std::vector<Part> parts(chunks);
  const kernels::Target target = {c.plane.as_float(), c.window.as_float(),
                                  static_cast<float>(kBiweight * kBiweight),
                                  static_cast<float>(kInlierSigmas * kInlierSigmas)};
  list = list && finish;
  const int threads = resolve_num_threads(num_threads);
  CloudMoments out;
  // One thread writes the list where it belongs; several write lists of their own.
  std::vector<int>* single = threads == 1 ? &out.inliers : nullptr;
  if (list && single) {
    single->clear();
    single->reserve(static_cast<std::size_t>(std::min(1.0, 1.1 * expected_share + 0.2) *
                                             static_cast<double>(n)));
  }
  const bool same = c.noise.kind == NoiseKind::kSame;
  const float same_weight = same ? static_cast<float>(1.0 / (c.noise.scale * c.noise.scale)) : 1.0f;
  const auto work = [&](std::size_t chunk) {
    alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
        weight[kernels::kBlock];
    alignas(32) std::int32_t mask[kernels::kBlock];
    int buffer[kernels::kBlock + kernels::kLanes];
    Part& part = parts[chunk];
    std::vector<int>& inliers = single ? *single : part.inliers;
    const std::size_t chunk_end = std::min(n, (chunk + 1) * kChunk);
    for (std::size_t begin = chunk * kChunk; begin < chunk_end; begin += kernels::kBlock) {
      const std::size_t m = std::min(kernels::kBlock, chunk_end - begin);
      const std::size_t first = source.stride * begin;
      const kernels::StridedPoints points = {source.x + first, source.y + first, source.z + first,
                                             source.stride, m};
      if (same) {
        const std::size_t filled = kernels::accumulate_and_list(
            points, pivot.data(), same_weight, target, static_cast<int>(begin),
            list ? buffer : nullptr, &part.moments);
        if (list) inliers.insert(inliers.end(), buffer, buffer + filled);
        continue;
      }
      kernels::load_points(points, pivot.data(), 1.0f, {x, y, z, weight});
      const std::size_t rows = kernels::padded(m);
      for (std::size_t k = m; k < rows; ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
      c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z, source.sigma ? source.sigma + begin : nullptr,
                    source.covariance ? source.covariance + begin : nullptr, weight);
      if (!finish) {
        kernels::accumulate({x, y, z, weight, rows}, target, kernels::Loss::kNewton, false,
                            &part.moments);
        continue;
      }
      kernels::accumulate_and_mark({x, y, z, weight, rows}, target, list ? mask : nullptr,
                                   source.stride == 3 && begin + 2 * kernels::kBlock <= n
                                       ? source.x + first + 3 * kernels::kBlock
                                       : nullptr,
                                   &part.moments);
      if (!list) continue;
      int filled = 0;
      for (std::size_t k = 0; k < m; ++k) {
        buffer[filled] = static_cast<int>(begin + k);
        filled -= mask[k];
      }
      inliers.insert(inliers.end(), buffer, buffer + filled);
    }
  };
  parallel_for(chunks, threads, work);
  for (const Part& part : parts) out.moments += part.moments;
  if (list && !single) {
    out.inliers.clear();
    out.inliers.reserve(static_cast<std::size_t>(out.moments.inliers));
    for (const Part& part : parts) {
      out.inliers.insert(out.inliers.end(), part.inliers.begin(), part.inliers.end());
    }
  }
  return out;
}

}  // namespace camber::detail
