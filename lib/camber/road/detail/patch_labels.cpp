#include "camber/road/detail/patch_labels.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "camber/core/threads.h"

namespace camber::detail {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

// A point belongs to a patch as far from its plane as points of the patch are more frequent than
// others; at least and at most this many standard deviations.
constexpr double kLeastLabelSigmas = 2.5, kMostLabelSigmas = 6.0;

/// How far above and below its plane a region's points reach, in standard deviations.
struct LabelGate {
  double below = kLeastLabelSigmas, above = kLeastLabelSigmas;
};

/// From the residuals in a region's leaves: outwards until there are no more than twice as many
/// points as farther out, or until there are more again (a pavement).
LabelGate measure_gate(const GroundTree& tree, const PlanarRegion& region) {
  constexpr double kBin = 0.5, kReach = 10.0;
  constexpr std::size_t kBins = 20;
  std::array<double, kBins> above{}, below{};
  const PointArrays& s = tree.points();
  const PlaneCandidate& c = region.candidate;
  std::array<float, 64> weights;
  for (const int leaf : region.leaves) {
    const GroundTree::Leaf& l = tree.leaves()[static_cast<std::size_t>(leaf)];
    const std::size_t b = l.begin, n = l.end - b;
    weights.fill(1.0f);
    c.noise.weigh(c.plane.n, c.plane.d, n, &s.x[b], &s.y[b], &s.z[b],
                  s.sigma.empty() ? nullptr : &s.sigma[b],
                  s.covariance.empty() ? nullptr : &s.covariance[b], weights.data());
    const kernels::FloatPlane p = c.plane.as_float();
    for (std::size_t k = 0; k < n; ++k) {
      if (!(weights[k] > 0.0f)) continue;
      const float r = p.nx * s.x[b + k] + p.ny * s.y[b + k] + p.nz * s.z[b + k] + p.d;
      const double t = static_cast<double>(r) * std::sqrt(static_cast<double>(weights[k]));
      if (!(std::abs(t) < kReach)) continue;
      const auto bin = static_cast<std::size_t>(std::abs(t) / kBin);
      (t > 0.0 ? above : below)[std::min(bin, kBins - 1)] += 1.0;
    }
  }
  const auto reach = [&](const std::array<double, kBins>& counts) {
    // Background: what lies between 7 and 10 standard deviations.
    double background = 0.0;
    for (std::size_t k = 14; k < kBins; ++k) background += counts[k] / 6.0;
    const auto first = static_cast<std::size_t>(kLeastLabelSigmas / kBin),
               last = static_cast<std::size_t>(kMostLabelSigmas / kBin);
    // A bin that is nearly too full or too empty counts in part, so that no single point decides.
    double sum = static_cast<double>(first), share = 1.0;
    for (std::size_t k = first; k < last && share > 0.0; ++k) {
      const double least = 2.0 * background + 1.0,
                   most = 0.9 * counts[k - 1] + 2.0 * std::sqrt(counts[k - 1]);
      const double slack = 0.5 * std::sqrt(std::max(counts[k], 4.0));
      share *= std::clamp((counts[k] - least) / slack + 0.5, 0.0, 1.0) *
               std::clamp((most - counts[k]) / slack + 0.5, 0.0, 1.0);
      sum += share;
    }
    return sum * kBin;
  };
  return {reach(below), reach(above)};
}

/// Which side of creases a place is on.
class CreaseCuts {
 public:
  explicit CreaseCuts(const std::vector<PlanarRegion>& regions) : regions_(regions) {}

  /// Whether a place belongs to region a rather than b: the sign of the difference of their heights
  /// is that at a's middle. 0 where the planes do not cross between the middles.
  int side(int a, int b, double x, double y) const {
    const PlanarRegion &ra = regions_[static_cast<std::size_t>(a)],
                       &rb = regions_[static_cast<std::size_t>(b)];
    const Vector3d &ca = ra.estimate.plane.centroid, &cb = rb.estimate.plane.centroid;
    const double at_a = difference(ra, rb, ca.x(), ca.y());
    const double at_b = difference(ra, rb, cb.x(), cb.y());
    if (!(at_a * at_b < 0.0)) return 0;
    return difference(ra, rb, x, y) * at_a >= 0.0 ? 1 : -1;
  }

 private:
  static double height(const PlanarRegion& region, double x, double y) {
    const PivotPlane& p = region.candidate.plane;
    return -(p.n.x() * x + p.n.y() * y + p.d) / p.n.z();
  }
  static double difference(const PlanarRegion& a, const PlanarRegion& b, double x, double y) {
    return height(a, x, y) - height(b, x, y);
  }
  const std::vector<PlanarRegion>& regions_;
};

/// Decides for points of one leaf which region they belong to.
class LeafLabels {
 public:
  LeafLabels(const Segmentation& segmentation, const GroundTree& tree, const CreaseCuts& cuts,
             const std::vector<LabelGate>& gates)
      : cuts_(cuts), gates_(gates) {
    choices_.resize(tree.leaves().size());
    for (std::size_t leaf = 0; leaf < choices_.size(); ++leaf) {
      std::vector<int>& list = choices_[leaf];
      const auto add = [&](int region) {
        if (region >= 0 && std::find(list.begin(), list.end(), region) == list.end()) {
          list.push_back(region);
        }
      };
      add(segmentation.leaf_region[leaf]);
      for (const int other : tree.neighbours()[leaf]) {
        add(segmentation.leaf_region[static_cast<std::size_t>(other)]);
      }
    }
  }
  const std::vector<int>& choices(std::size_t leaf) const { return choices_[leaf]; }

  /// @param distance  of the point above each choice's plane, in standard deviations
  int choose(std::size_t leaf, const Vector3d& p, const std::vector<double>& distance) const {
    const std::vector<int>& list = choices_[leaf];
    int best = -1;
    double best_distance = 0.0;
    for (std::size_t k = 0; k < list.size(); ++k) {
      const LabelGate& gate = gates_[static_cast<std::size_t>(list[k])];
      if (!(distance[k] > -gate.below && distance[k] < gate.above)) continue;
      const double away = std::abs(distance[k]);
      // On several: the crease decides if there is one, else the nearest plane.
      const int side = best < 0 ? 1 : cuts_.side(list[k], best, p.x(), p.y());
      if (side > 0 || (side == 0 && away < best_distance)) {
        best = list[k];
        best_distance = away;
      }
    }
    return best;
  }

 private:
  const CreaseCuts& cuts_;
  const std::vector<LabelGate>& gates_;
  std::vector<std::vector<int>> choices_;
};

class RowLabeller {
 public:
  RowLabeller(const Segmentation& segmentation, const LeafLabels& chooser)
      : segmentation_(segmentation), chooser_(chooser) {
    for (const PlanarRegion& region : segmentation.regions) {
      const NoiseModel& noise = region.candidate.noise;
      float weight = 1.0f;
      if (noise.kind == NoiseKind::kSame) {
        noise.weigh({}, 0.0, 1, nullptr, nullptr, nullptr, nullptr, nullptr, &weight);
      }
      same_roots_.push_back(noise.kind == NoiseKind::kSame ? std::sqrt(static_cast<double>(weight))
                                                           : 0.0);
    }
  }

  /// The label of the first row of `s`, which lies in a leaf.
  int label_first(const PointArrays& s, std::size_t leaf) {
    const std::vector<int>& list = chooser_.choices(leaf);
    if (list.empty()) return -1;
    const Vector3d p = s.point(0);
    distance_.resize(list.size());
    for (std::size_t c = 0; c < list.size(); ++c) {
      const PlaneCandidate& candidate = region(list[c]).candidate;
      double root = same_roots_[static_cast<std::size_t>(list[c])];
      if (!(root > 0.0)) {
        float weight = 1.0f;
        candidate.noise.weigh(candidate.plane.n, candidate.plane.d, 1, s.x.data(), s.y.data(),
                              s.z.data(), s.sigma.data(), s.covariance.data(), &weight);
        root = std::sqrt(static_cast<double>(weight));
      }
      distance_[c] = root > 0.0 ? candidate.plane.distance(p) * root : 1e30;
    }
    return chooser_.choose(leaf, p, distance_);
  }

  /// Labels rows [begin, end) of `s`, which lie in one leaf, into out[0 ...].
  void label(const PointArrays& s, std::size_t begin, std::size_t end, std::size_t leaf, int* out) {
    const std::vector<int>& list = chooser_.choices(leaf);
    const std::size_t n = end - begin;
    if (list.empty()) {
      std::fill(out, out + n, -1);
      return;
    }
    if (weights_.size() < list.size()) weights_.resize(list.size());
    for (std::size_t c = 0; c < list.size(); ++c) {
      if (same_roots_[static_cast<std::size_t>(list[c])] > 0.0) continue;
      const PlaneCandidate& candidate = region(list[c]).candidate;
      weights_[c].assign(n, 1.0f);
      candidate.noise.weigh(candidate.plane.n, candidate.plane.d, n, &s.x[begin], &s.y[begin],
                            &s.z[begin], s.sigma.empty() ? nullptr : &s.sigma[begin],
                            s.covariance.empty() ? nullptr : &s.covariance[begin],
                            weights_[c].data());
    }
    distance_.resize(list.size());
    for (std::size_t k = 0; k < n; ++k) {
      const Vector3d p = s.point(begin + k);
      for (std::size_t c = 0; c < list.size(); ++c) {
        const double same = same_roots_[static_cast<std::size_t>(list[c])];
        const double root = same > 0.0 ? same : std::sqrt(static_cast<double>(weights_[c][k]));
        distance_[c] = root > 0.0 ? region(list[c]).candidate.plane.distance(p) * root : 1e30;
      }
      out[k] = chooser_.choose(leaf, p, distance_);
    }
  }

 private:
  const PlanarRegion& region(int index) const {
    return segmentation_.regions[static_cast<std::size_t>(index)];
  }
  const Segmentation& segmentation_;
  const LeafLabels& chooser_;
  std::vector<std::vector<float>> weights_;
  std::vector<double> same_roots_;  // of each region's weight, where all points have one; else 0
  std::vector<double> distance_;
};

/// Region of every row of the tree, -1: none.
std::vector<int> label_rows(const GroundTree& tree, const Segmentation& segmentation,
                            const LeafLabels& chooser, int num_threads) {
  std::vector<int> labels(tree.cloud_index().size(), -1);
  constexpr std::size_t kBatch = 256;
  const std::size_t leaves = tree.leaves().size();
  parallel_for((leaves + kBatch - 1) / kBatch, num_threads, [&](std::size_t batch) {
    RowLabeller labeller(segmentation, chooser);
    for (std::size_t leaf = batch * kBatch; leaf < std::min(leaves, (batch + 1) * kBatch); ++leaf) {
      const GroundTree::Leaf& l = tree.leaves()[leaf];
      labeller.label(tree.points(), l.begin, l.end, leaf, labels.data() + l.begin);
    }
  });
  return labels;
}

/// Region of every point of a cloud of which the tree holds only a part.
std::vector<int> label_cloud(const RoadCloud& cloud, const GroundTree& tree,
                             const Segmentation& segmentation, const LeafLabels& chooser,
                             int num_threads) {
  std::vector<int> labels(cloud.size(), -1);
  constexpr std::size_t kBatch = 65536;
  const Eigen::Matrix3d turn = tree.frame().level_from_cloud;
  const Vector3d shift = tree.frame().pivot - cloud.origin;
  const bool sigmas = !cloud.sigmas.empty(), covariances = !cloud.covariances.empty();
  parallel_for((cloud.size() + kBatch - 1) / kBatch, num_threads, [&](std::size_t batch) {
    RowLabeller labeller(segmentation, chooser);
    PointArrays one;
    one.resize(1, sigmas, covariances);
    const std::size_t end = std::min(cloud.size(), (batch + 1) * kBatch);
    constexpr std::size_t kBlock = 256;
    struct Place {
      float x, y, z;
      int entry;
    };
    std::array<Place, kBlock> places;
    for (std::size_t first = batch * kBatch; first < end; first += kBlock) {
      const std::size_t count = std::min(kBlock, end - first);
      for (std::size_t k = 0; k < count; ++k) {
        const Vector3d p = turn * (cloud.points[first + k].cast<double>() - shift);
        Place& place = places[k];
        place = {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()),
                 -1};
        if (p.squaredNorm() < 1e30) place.entry = tree.entry(place.x, place.y);
      }
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t i = first + k;
        const int leaf = tree.locate_from(places[k].entry, places[k].x, places[k].y);
        if (leaf < 0) continue;
        one.x[0] = places[k].x;
        one.y[0] = places[k].y;
        one.z[0] = places[k].z;
        if (sigmas) one.sigma[0] = cloud.sigmas[i];
        if (covariances) one.covariance[0] = cloud.covariances[i];
        labels[i] = labeller.label_first(one, static_cast<std::size_t>(leaf));
      }
    }
  });
  return labels;
}

}  // namespace

PatchLabels label_patches(const RoadCloud& cloud, bool whole, const GroundTree& tree,
                          const Segmentation& segmentation, int num_threads) {
  const CreaseCuts cuts(segmentation.regions);
  std::vector<LabelGate> gates(segmentation.regions.size());
  parallel_for(gates.size(), num_threads, [&](std::size_t region) {
    gates[region] = measure_gate(tree, segmentation.regions[region]);
  });
  const LeafLabels chooser(segmentation, tree, cuts, gates);
  PatchLabels out;
  out.rows = label_rows(tree, segmentation, chooser, num_threads);
  if (!whole) {
    out.cloud = label_cloud(cloud, tree, segmentation, chooser, num_threads);
    return out;
  }
  out.cloud.assign(cloud.size(), -1);
  for (std::size_t k = 0; k < out.rows.size(); ++k) {
    const std::uint32_t index = tree.cloud_index()[k];
    if (index != GroundTree::kPadding) out.cloud[index] = out.rows[k];
  }
  return out;
}

}  // namespace camber::detail
