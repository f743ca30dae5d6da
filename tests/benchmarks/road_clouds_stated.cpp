// What fits to made road clouds state of themselves against their truth: 95 % regions, and answers
// for the same cloud in another order or place.

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include "benchmarks/road_clouds.h"
#include "camber/core/random.h"
#include "road/patch_score.h"

namespace camber::benchmarks {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;
using test::PatchScore;
using test::RoadScene;

/// Change from an estimate to the truth in the estimate's parameters: tilts and height.
Vector3d plane_error(const UncertainPlane& estimate, const Plane& truth) {
  const Vector3d turn = estimate.plane.normal.cross(truth.normal);
  return {turn.dot(estimate.axis1), turn.dot(estimate.axis2),
          -truth.signed_distance(estimate.centroid) / truth.normal.dot(estimate.plane.normal)};
}

/// How often truths lie inside the stated 95 % regions.
struct Coverage {
  double normals = 0, heights = 0, all = 0, count = 0;
  void add(const UncertainPlane& estimate, const Plane& truth) {
    const Vector3d e = plane_error(estimate, truth);
    const Eigen::Matrix3d& c = estimate.covariance;
    const Eigen::Matrix2d tilt = c.topLeftCorner<2, 2>();
    const Vector2d t = e.head<2>();
    // Chi-square, 95 %, for 2, 1 and 3 degrees of freedom.
    normals += t.dot(tilt.inverse() * t) <= 5.991 ? 1 : 0;
    heights += e.z() * e.z() / c(2, 2) <= 3.841 ? 1 : 0;
    all += e.dot(c.inverse() * e) <= 7.815 ? 1 : 0;
    count += 1;
  }
  void print(const std::string& name, bench::Table& table) const {
    table.row({name, 100 * normals / count, 100 * heights / count, 100 * all / count, count});
    std::printf("%-44s normal %.1f %%, offset %.1f %%, both together %.1f %% of %.0f\n",
                name.c_str(), 100 * normals / count, 100 * heights / count, 100 * all / count,
                count);
  }
};

}  // namespace

void coverage(const Bench& bench) {
  bench::Table& table = bench.report.table(
      "coverage", "Share of truths inside the stated 95 % regions", "coverage",
      {bench::label("planes"), bench::value("normal", "%"), bench::value("offset", "%"),
       bench::value("both together", "%"), bench::value("of")});
  std::printf("\n## Coverage of the stated 95 %% regions, %zu seeded scenes each\n", bench.scenes);
  for (const std::size_t points : {2000ul, 10000ul, 100000ul}) {
    for (const bool sigmas : {false, true}) {
      Coverage of_planes;
      for (std::size_t seed = 0; seed < bench.scenes; ++seed) {
        const RoadScene scene = bench.made_scene(1, points, sigmas, 5000 + seed);
        const PlaneFit fit = fit_plane(scene.cloud, bench.plane_options());
        if (fit.status == Status::kFailed) continue;
        of_planes.add(fit.plane, scene.planes[0]);
      }
      of_planes.print("one plane, " + count_name(points) + (sigmas ? ", sigmas" : ", x y z"),
                      table);
    }
  }
  for (const int k : {3, 12}) {
    const std::size_t scenes = std::max<std::size_t>(1, bench.scenes / static_cast<std::size_t>(k));
    for (const bool sigmas : {false, true}) {
      for (const Consistency consistency : {Consistency::kNone, Consistency::kContinuity}) {
        Coverage of_patches;
        for (std::size_t seed = 0; seed < scenes; ++seed) {
          const RoadScene scene = bench.made_scene(k, 50000, sigmas, 6000 + seed);
          RoadSurfaceOptions options = bench.surface_options();
          options.consistency.consistency = consistency;
          const RoadSurfaceFit fit = fit_road_surface(scene.cloud, options);
          const PatchScore score = test::score_patches(scene, planes_of(fit.surface), fit.labels);
          for (std::size_t a = 0; a < scene.planes.size(); ++a) {
            if (score.best[a] < 0) continue;
            of_patches.add(fit.surface.patches[static_cast<std::size_t>(score.best[a])].plane,
                           scene.planes[a]);
          }
        }
        of_patches.print("patches of " + std::to_string(k) + " planes, 50000" +
                             (sigmas ? ", sigmas" : ", x y z") +
                             (consistency == Consistency::kNone ? ", not joined" : ", joined"),
                         table);
      }
    }
  }
}

namespace {

/// Largest difference of two estimates in standard deviations of the first.
double difference_in_sigmas(const UncertainPlane& a, const Plane& b) {
  const Vector3d e = plane_error(a, b);
  const Vector3d sigma = a.covariance.diagonal().cwiseSqrt();
  return (e.cwiseAbs().array() / sigma.array()).maxCoeff();
}

/// A scene in another order or place, and how to come back.
struct Disturbance {
  const char* name;
  bool shuffle = false;
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Vector3d shift = Vector3d::Zero();
};

}  // namespace

void repeat(const Bench& bench) {
  bench::Table& table = bench.report.table(
      "repeat", "Same cloud in another order or place: change in stated sigmas", "repeat",
      {bench::label("with"), bench::label("change"), bench::lower("one plane, median", "sigma"),
       bench::lower("one plane, worst", "sigma"), bench::lower("patches, median", "sigma"),
       bench::lower("patches, 90 %", "sigma"), bench::lower("patches, 99 %", "sigma"),
       bench::lower("patches, worst", "sigma"), bench::higher("patches within 0.1 sigma", "%"),
       bench::higher("labels equal", "%"), bench::higher("labels equal, worst scene", "%"),
       bench::higher("as many patches", "%")});
  std::printf("\n## Same cloud in another order or place: planes in stated sigmas, labels\n");
  std::vector<Disturbance> kinds(5);
  kinds[0].name = "shuffled";
  kinds[0].shuffle = true;
  kinds[1].name = "moved by (37, -12, 5) m";
  kinds[1].shift = {37, -12, 5};
  kinds[2].name = "turned by 30 deg about up";
  kinds[2].turn = Eigen::AngleAxisd(30 * kDegree, Vector3d::UnitZ()).toRotationMatrix();
  kinds[3].name = "turned, moved and shuffled";
  kinds[3].turn = Eigen::AngleAxisd(200 * kDegree, Vector3d::UnitZ()).toRotationMatrix();
  kinds[3].shift = {-210, 90, 31};
  kinds[3].shuffle = true;
  kinds[4].name = "tilted with its up";
  kinds[4].turn = Eigen::AngleAxisd(1.1, Vector3d(0.3, -0.8, 0.2).normalized()).toRotationMatrix();
  for (const bool sigmas : {false, true}) {
    for (const Disturbance& kind : kinds) {
      std::vector<double> plane_sigmas, patch_sigmas, equal, counts;
      for (std::uint64_t seed = 0; seed < 10; ++seed) {
        for (const int k : {1, 3, 6, 12}) {
          const RoadScene scene =
              bench.made_scene(k, k == 1 ? 200000 : 100000, sigmas, 7000 + seed);
          const std::size_t n = scene.cloud.size();
          std::vector<int> order(n);
          std::iota(order.begin(), order.end(), 0);
          const CounterRandom random(bench.of_cloud(seed), 77);
          if (kind.shuffle) {
            for (std::size_t i = n - 1; i > 0; --i)
              std::swap(order[i], order[random.below(i, i + 1)]);
          }
          RoadCloud other = scene.cloud.select(order);
          for (Vector3f& p : other.points) {
            p = (kind.turn * p.cast<double>() + kind.shift).cast<float>();
          }
          const auto back = [&](const Plane& plane) {
            return plane.transformed(
                SE3(kind.turn.transpose(), -(kind.turn.transpose() * kind.shift)));
          };
          const Vector3d up = kind.turn * Vector3d::UnitZ();
          if (k == 1) {
            PlaneFitOptions options = bench.plane_options();
            const PlaneFit a = fit_plane(scene.cloud, options);
            options.up = up;
            const PlaneFit b = fit_plane(other, options);
            plane_sigmas.push_back(difference_in_sigmas(a.plane, back(b.plane.plane)));
            continue;
          }
          RoadSurfaceOptions options = bench.surface_options();
          const RoadSurfaceFit a = fit_road_surface(scene.cloud, options);
          options.up = up;
          const RoadSurfaceFit b = fit_road_surface(other, options);
          // Patches of b by those of a: the one that holds most of the same points.
          std::vector<std::map<int, int>> shared(a.surface.patches.size());
          for (std::size_t i = 0; i < n; ++i) {
            const int la = a.labels[static_cast<std::size_t>(order[i])], lb = b.labels[i];
            if (la >= 0 && lb >= 0) ++shared[static_cast<std::size_t>(la)][lb];
          }
          std::vector<int> partner(shared.size(), -2);
          for (std::size_t p = 0; p < shared.size(); ++p) {
            int most = 0;
            for (const auto& [id, count] : shared[p]) {
              if (count > most) {
                most = count;
                partner[p] = id;
              }
            }
          }
          double same = 0.0;
          for (std::size_t i = 0; i < n; ++i) {
            const int la = a.labels[static_cast<std::size_t>(order[i])], lb = b.labels[i];
            same += (la < 0 ? lb < 0 : partner[static_cast<std::size_t>(la)] == lb) ? 1.0 : 0.0;
          }
          equal.push_back(same / static_cast<double>(n));
          counts.push_back(a.surface.patches.size() == b.surface.patches.size() ? 1.0 : 0.0);
          for (std::size_t p = 0; p < shared.size(); ++p) {
            if (a.surface.patches[p].kind == PatchKind::kOther || partner[p] < 0) continue;
            patch_sigmas.push_back(difference_in_sigmas(
                a.surface.patches[p].plane,
                back(b.surface.patches[static_cast<std::size_t>(partner[p])].plane.plane)));
          }
        }
      }
      std::printf(
          "%-7s %-27s one plane: median %.3f, worst %.3f sigma; patches: median %.3f, 90 %% %.3f, "
          "99 %% %.3f, worst %.3f sigma, %.2f %% within 0.1, labels equal %.3f %% (worst scene "
          "%.3f %%), as many patches in %.0f "
          "%%\n",
          sigmas ? "sigmas" : "x y z", kind.name, quantile_of(plane_sigmas, 0.5),
          quantile_of(plane_sigmas, 1.0), quantile_of(patch_sigmas, 0.5),
          quantile_of(patch_sigmas, 0.9), quantile_of(patch_sigmas, 0.99),
          quantile_of(patch_sigmas, 1.0), 100 * share_below(patch_sigmas, 0.1),
          100 * mean_of(equal), 100 * quantile_of(equal, 0.0), 100 * mean_of(counts));
      table.row({sigmas ? "sigmas" : "x y z", kind.name, quantile_of(plane_sigmas, 0.5),
                 quantile_of(plane_sigmas, 1.0), quantile_of(patch_sigmas, 0.5),
                 quantile_of(patch_sigmas, 0.9), quantile_of(patch_sigmas, 0.99),
                 quantile_of(patch_sigmas, 1.0), 100 * share_below(patch_sigmas, 0.1),
                 100 * mean_of(equal), 100 * quantile_of(equal, 0.0), 100 * mean_of(counts)});
    }
  }
}

}  // namespace camber::benchmarks
