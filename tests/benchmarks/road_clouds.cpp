// Planes, patches and profiles of road clouds against their truth, and against other libraries in
// the same run. Prints its tables. Arguments: names of sections (plane, largest, patches, coverage,
// repeat, hill, real; none: all), --scenes N seeds of the coverage (1000), --largest N points of
// the largest clouds (10000000), --plot FILE.svg for the hill. Real data: $CAMBER_DATA, else
// ../shared/data.

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "benchmarks/road_cloud_peers.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "camber/plane/fit_plane.h"
#include "camber/render/plot.h"
#include "camber/road/fit_road_surface.h"
#include "camber/road/road_profile.h"
#include "plane/road_scene_maker.h"
#include "road/patch_score.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber::benchmarks {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;
using test::PatchScore;
using test::RoadScene;

constexpr double kDegree = M_PI / 180.0;

std::size_t g_scenes = 1000;
std::size_t g_largest = 10000000;
std::string g_plot;  ///< SVG of the hill, empty: none

/// K planes with the outliers that the table asks for.
RoadScene made_scene(int planes, std::size_t points, bool sigmas, std::uint64_t seed) {
  test::RoadSceneOptions options;
  options.seed = seed;
  options.planes = planes;
  options.points = points;
  options.outlier_share = planes == 3 ? 0.1 : planes == 12 ? 0.5 : 0.3;
  options.with_sigmas = sigmas;
  return test::make_road_scene(options);
}

double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

double mean_of(const std::vector<double>& values) {
  return values.empty() ? std::nan("")
                        : std::accumulate(values.begin(), values.end(), 0.0) /
                              static_cast<double>(values.size());
}

double share_below(const std::vector<double>& values, double bound) {
  const auto below =
      std::count_if(values.begin(), values.end(), [&](double v) { return v < bound; });
  return static_cast<double>(below) / std::max(static_cast<double>(values.size()), 1.0);
}

/// Least CPU milliseconds of a few calls.
double least_ms(int repeats, const std::function<void()>& call) {
  double least = 1e300;
  for (int k = 0; k < repeats; ++k) {
    const double start = cpu_ms();
    call();
    least = std::min(least, cpu_ms() - start);
  }
  return least;
}

int repeats_for(std::size_t points) { return points > 2000000 ? 3 : points > 200000 ? 7 : 15; }

/// Mean of the points of a true plane.
Vector3d middle_of(const RoadScene& scene, int plane) {
  Vector3d sum = Vector3d::Zero();
  double count = 0.0;
  for (std::size_t i = 0; i < scene.truth.size(); ++i) {
    if (scene.truth[i] != plane) continue;
    sum += scene.cloud.points[i].cast<double>();
    count += 1.0;
  }
  return scene.planes[static_cast<std::size_t>(plane)].foot(sum / count);
}

std::string count_name(std::size_t points) {
  const double power = std::log10(static_cast<double>(points));
  return power == std::floor(power) ? "1e" + std::to_string(static_cast<int>(power))
                                    : std::to_string(points);
}

struct PlaneErrors {
  std::vector<double> angles, heights, ms;
  int same = 0;  ///< fits of the true plane with the most points
  void add(const RoadScene& scene, const Plane& plane, double milliseconds) {
    // The nearest of the true planes that is as large as the largest, to within 2 %.
    std::vector<double> counts(scene.planes.size(), 0.0);
    for (const int k : scene.truth) {
      if (k >= 0) counts[static_cast<std::size_t>(k)] += 1.0;
    }
    const double most = *std::max_element(counts.begin(), counts.end());
    double angle = 1e9, height = 1e9;
    bool large = false;
    for (std::size_t k = 0; k < scene.planes.size(); ++k) {
      const double a = angle_between(plane.normal, scene.planes[k].normal);
      if (a >= angle) continue;
      angle = a;
      height = std::abs(plane.signed_distance(middle_of(scene, static_cast<int>(k))));
      large = counts[k] >= 0.98 * most;
    }
    same += large ? 1 : 0;
    angles.push_back(angle / kDegree);
    heights.push_back(1e3 * height);
    ms.push_back(milliseconds);
  }
  void print(const char* name, std::size_t points, bool sigmas, double against) const {
    std::printf("%-12s %-5s %-8s %9.2f ms", name, count_name(points).c_str(),
                sigmas ? "sigmas" : "x y z", mean_of(ms));
    if (against > 0.0) {
      std::printf("  (%6.1f x)", mean_of(ms) / against);
    } else {
      std::printf("            ");
    }
    std::printf("  %.4f deg (worst %.4f)  %.2f mm (worst %.2f)  largest plane %d of %zu\n",
                mean_of(angles), quantile_of(angles, 1.0), mean_of(heights),
                quantile_of(heights, 1.0), same, angles.size());
  }
};

/// One plane, alone or the largest of several, against PCL.
void one_plane(int planes, const char* title) {
  std::printf("\n## %s\n", title);
  std::printf("CPU time of compute, one thread, mean over scenes of the least of several runs\n");
  for (std::size_t points = 10000; points <= g_largest; points *= 10) {
    const int scenes = points >= 10000000 ? 2 : points >= 1000000 ? 6 : 20;
    for (const bool sigmas : {false, true}) {
      PlaneErrors ours, ransac, msac;
      for (int seed = 0; seed < scenes; ++seed) {
        const RoadScene scene =
            made_scene(planes, points, sigmas, 1000 + static_cast<std::uint64_t>(seed));
        PlaneFitOptions options;
        options.num_threads = 1;
        PlaneFit fit;
        const double ms =
            least_ms(repeats_for(points), [&] { fit = fit_plane(scene.cloud, options); });
        ours.add(scene, fit.plane.plane, ms);
        const bool peers =
            !sigmas && seed < (points >= 1000000 ? 2 : 5) && (planes == 1 || points <= 1000000);
        if (!peers) continue;
        for (const bool use_msac : {false, true}) {
          // Not the least of several runs: PCL's own seed makes every run alike.
          const PeerAnswer answer = pcl_plane(scene.cloud, use_msac, 10000);
          if (!answer.planes.empty()) {
            (use_msac ? msac : ransac).add(scene, answer.planes[0], answer.ms);
          }
        }
      }
      ours.print("Camber", points, sigmas, 0.0);
      if (!ransac.ms.empty()) ransac.print("PCL RANSAC", points, sigmas, mean_of(ours.ms));
      if (!msac.ms.empty()) msac.print("PCL MSAC", points, sigmas, mean_of(ours.ms));
    }
  }
}

struct PatchErrors {
  int scenes = 0, complete = 0, found = 0, planes = 0, road = 0;
  double least_overlap = 1.0, worst_angle = 0.0, worst_height = 0.0;
  std::vector<double> overlaps, angles, heights, ms, extra;
  void add(const PatchScore& score, int truths, double milliseconds) {
    ++scenes;
    complete += score.found == truths ? 1 : 0;
    found += score.found;
    planes += truths;
    overlaps.push_back(score.mean_overlap);
    angles.push_back(score.mean_angle / kDegree);
    heights.push_back(1e3 * score.mean_height);
    least_overlap = std::min(least_overlap, score.mean_overlap);
    worst_angle = std::max(worst_angle, score.worst_angle / kDegree);
    worst_height = std::max(worst_height, 1e3 * score.worst_height);
    ms.push_back(milliseconds);
  }
  void print(const char* name, int k, std::size_t points, const char* kind) const {
    std::printf(
        "%-22s K=%-2d %-5s %-13s %9.2f ms  %d of %d planes, %d of %d scenes whole, mean IoU %.3f "
        "(worst scene %.3f), %.4f deg (worst %.3f), %.1f mm (worst %.1f)\n",
        name, k, count_name(points).c_str(), kind, mean_of(ms), found, planes, complete, scenes,
        mean_of(overlaps), least_overlap, mean_of(angles), worst_angle, mean_of(heights),
        worst_height);
  }
};

std::vector<Plane> planes_of(const RoadSurface& surface) {
  std::vector<Plane> planes;
  for (const PlanePatch& patch : surface.patches) planes.push_back(patch.plane.plane);
  return planes;
}

void patches() {
  std::printf("\n## Multi-plane patches\n");
  std::printf("CPU time of compute, one thread, mean over scenes of the least of several runs\n");
  bool missing = false;
  for (const int k : {1, 3, 6, 12}) {
    for (std::size_t points = 10000; points <= g_largest; points *= 10) {
      const int scenes = points >= 10000000 ? 1 : points >= 1000000 ? 4 : 20;
      for (const bool sigmas : {false, true}) {
        PatchErrors ours, cgal;
        double normals = 0.0;
        for (int seed = 0; seed < scenes; ++seed) {
          const RoadScene scene =
              made_scene(k, points, sigmas, 2000 + static_cast<std::uint64_t>(seed));
          RoadSurfaceOptions options;
          options.num_threads = 1;
          RoadSurfaceFit fit;
          const int repeats = points >= 1000000 ? 2 : 5;
          const double ms =
              least_ms(repeats, [&] { fit = fit_road_surface(scene.cloud, options); });
          ours.add(test::score_patches(scene, planes_of(fit.surface), fit.labels), k, ms);
          for (const PlanePatch& p : fit.surface.patches) ours.road += p.kind == PatchKind::kRoad;
          if (sigmas || k == 1 || points != 100000 || seed >= 3) continue;
          const PeerAnswer answer = cgal_planes(scene.cloud, points / 100);
          missing = missing || !answer.available;
          if (!answer.available) continue;
          cgal.add(test::score_patches(scene, answer.planes, answer.labels), k,
                   answer.ms + answer.normals_ms);
          normals += answer.normals_ms / 3.0;
        }
        ours.print("Camber", k, points, sigmas ? "sigmas" : "x y z");
        if (cgal.scenes > 0) {
          cgal.print("CGAL Efficient RANSAC", k, points, "x y z");
          std::printf(
              "%-22s of these %.1f ms for normals; Camber is %.1f x as fast, %.1f x without them\n",
              "", normals, mean_of(cgal.ms) / mean_of(ours.ms),
              (mean_of(cgal.ms) - normals) / mean_of(ours.ms));
        }
      }
    }
  }
  if (missing) std::printf("CGAL is skipped: the program was built without libcgal-dev\n");
}

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
  void print(const std::string& name) const {
    std::printf("%-44s normal %.1f %%, offset %.1f %%, both together %.1f %% of %.0f\n",
                name.c_str(), 100 * normals / count, 100 * heights / count, 100 * all / count,
                count);
  }
};

void coverage() {
  std::printf("\n## Coverage of the stated 95 %% regions, %zu seeded scenes each\n", g_scenes);
  for (const std::size_t points : {2000ul, 10000ul, 100000ul}) {
    for (const bool sigmas : {false, true}) {
      Coverage of_planes;
      for (std::size_t seed = 0; seed < g_scenes; ++seed) {
        const RoadScene scene = made_scene(1, points, sigmas, 5000 + seed);
        const PlaneFit fit = fit_plane(scene.cloud, {});
        if (fit.status == Status::kFailed) continue;
        of_planes.add(fit.plane, scene.planes[0]);
      }
      of_planes.print("one plane, " + count_name(points) + (sigmas ? ", sigmas" : ", x y z"));
    }
  }
  for (const int k : {3, 12}) {
    const std::size_t scenes = std::max<std::size_t>(1, g_scenes / static_cast<std::size_t>(k));
    for (const bool sigmas : {false, true}) {
      for (const Consistency consistency : {Consistency::kNone, Consistency::kContinuity}) {
        Coverage of_patches;
        for (std::size_t seed = 0; seed < scenes; ++seed) {
          const RoadScene scene = made_scene(k, 50000, sigmas, 6000 + seed);
          RoadSurfaceOptions options;
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
                         (consistency == Consistency::kNone ? ", not joined" : ", joined"));
      }
    }
  }
}

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

void repeat() {
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
          const RoadScene scene = made_scene(k, k == 1 ? 200000 : 100000, sigmas, 7000 + seed);
          const std::size_t n = scene.cloud.size();
          std::vector<int> order(n);
          std::iota(order.begin(), order.end(), 0);
          const CounterRandom random(seed, 77);
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
            PlaneFitOptions options;
            const PlaneFit a = fit_plane(scene.cloud, options);
            options.up = up;
            const PlaneFit b = fit_plane(other, options);
            plane_sigmas.push_back(difference_in_sigmas(a.plane, back(b.plane.plane)));
            continue;
          }
          RoadSurfaceOptions options;
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
    }
  }
}

/// A camera 1.65 m above a level road that bends to a grade 12 m ahead and to twice that 24 m
/// ahead, reconstructed too small by 10 %: the metric scale of each patch by its own height, and by
/// the ego patch's. The plot, where asked for, is the road in profile.
void hill() {
  std::printf(
      "\n## Scale on hills: a reconstruction 10 %% too small, camera 1.65 m above the road\n");
  constexpr double kScale = 0.9, kHeight = 1.65, kWidth = 8.0;
  PlotSheet sheet;
  sheet.title = "Metric scale of a road that bends, camera 1.65 m above it";
  for (const double grade_deg : {4.0, -4.0}) {
    // Camera frame: x right, y down, z forward.
    const double bends[] = {12.0, 24.0, 36.0};
    const auto height = [&](double z) {
      const double g = std::tan(grade_deg * kDegree), g2 = std::tan(2 * grade_deg * kDegree);
      return z < bends[0]   ? 0.0
             : z < bends[1] ? g * (z - bends[0])
                            : g * (bends[1] - bends[0]) + g2 * (z - bends[1]);
    };
    RoadCloud cloud;
    cloud.frame = CloudFrame::kCamera;
    const CounterRandom random(5, 41);
    for (std::uint64_t i = 0; i < 60000; ++i) {
      const double x = random.uniform(2 * i, -0.5 * kWidth, 0.5 * kWidth),
                   z = random.uniform(2 * i + 1, 4.0, bends[2]);
      Vector3d p(x, kHeight - height(z), z);
      const double r = p.norm(), sigma = 0.5 * r * r / 718.0;
      p += sigma * random.normal(3 * i) * p / r;
      p.y() += 0.5 * r / 718.0 * random.normal(3 * i + 1);
      cloud.points.push_back((kScale * p).cast<float>());
      cloud.sigmas.push_back(static_cast<float>(kScale * sigma));
    }
    const RoadSurfaceFit fit = fit_road_surface(cloud, {});
    const PlanePatch* ego = fit.surface.find(fit.surface.ego_patch);
    if (!ego) continue;
    const double ego_scale = kHeight / ego->plane.plane.offset;
    std::printf("grade %+.0f then %+.0f deg; scale by the ego patch alone: %+.2f %% off\n",
                grade_deg, 2 * grade_deg, 100 * (ego_scale * kScale - 1.0));
    std::vector<const PlanePatch*> order;
    for (const PlanePatch& patch : fit.surface.patches) {
      if (patch.kind == PatchKind::kRoad && patch.inliers > 1000) order.push_back(&patch);
    }
    std::sort(order.begin(), order.end(), [](const PlanePatch* l, const PlanePatch* r) {
      return l->plane.centroid.z() < r->plane.centroid.z();
    });
    PlotSeries truth, graph, own_height;
    truth.name = "true road";
    truth.color = {185, 185, 185, 1.0};
    truth.thickness = 8.0;
    graph.name = "patches scaled by the ego patch and the graph";
    graph.color = plot_color(0);
    own_height.name = "each patch by its own median height";
    own_height.color = plot_color(1);
    own_height.thickness = graph.thickness = 2.5;
    const auto draw = [](PlotSeries* series, const Vector2d& from, const Vector2d& to) {
      constexpr double kGap = std::numeric_limits<double>::quiet_NaN();
      series->x.insert(series->x.end(), {from.x(), to.x(), kGap});
      series->y.insert(series->y.end(), {from.y(), to.y(), kGap});
    };
    truth.x = {0.0, bends[0], bends[1], bends[2]};
    for (const double z : truth.x) truth.y.push_back(height(z));
    for (const PlanePatch* patch : order) {
      // Its own height: the median of what its points lie below the camera.
      std::vector<double> below;
      double near = 1e9, far = 0.0;
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (fit.labels[i] != patch->id) continue;
        below.push_back(static_cast<double>(cloud.points[i].y()));
        near = std::min(near, static_cast<double>(cloud.points[i].z()));
        far = std::max(far, static_cast<double>(cloud.points[i].z()));
      }
      const double own = kHeight / quantile_of(below, 0.5);
      const double by_plane = kHeight / patch->plane.plane.offset;
      const Vector3d c = patch->plane.centroid;
      // Height of its middle above the road under the camera, against the truth there.
      const auto off = [&](double scale) {
        return kHeight - scale * c.y() - height(c.z() / kScale);
      };
      std::printf(
          "  patch around %4.1f m: scale by its median height %+8.1f %% off, middle %+7.2f m off; "
          "by "
          "its plane's height %+7.1f %%, %+7.2f m; by the graph %+5.2f %%, %+6.3f m\n",
          c.z() / kScale, 100 * (own * kScale - 1.0), off(own), 100 * (by_plane * kScale - 1.0),
          off(by_plane), 100 * (ego_scale * kScale - 1.0), off(ego_scale));
      const Plane& plane = patch->plane.plane;
      const auto place = [&](double z, double scale) {
        const double y = -(plane.normal.z() * z + plane.offset) / plane.normal.y();
        return Vector2d(scale * z, kHeight - scale * y);
      };
      draw(&graph, place(near, ego_scale), place(far, ego_scale));
      if (own > 0.0 && own * far < 60.0) {
        draw(&own_height, place(near, own), place(far, own));
      } else {
        own_height.name += " (one without meaning left out)";
      }
    }
    Plot plot;
    plot.title = "Grade " + std::string(grade_deg > 0 ? "+" : "-") + "4 deg from 12 m, " +
                 (grade_deg > 0 ? "+" : "-") + "8 deg from 24 m ahead";
    plot.x.title = "distance ahead of the camera, m";
    plot.y.title = "height above the near road, m";
    plot.x.low = 0.0;
    plot.series = {truth, graph, own_height};
    sheet.panels.push_back(plot);
  }
  if (g_plot.empty()) return;
  std::ofstream(g_plot) << plots_svg(sheet, {900, 330, 18.0});
  std::printf("plot: %s\n", g_plot.c_str());
}

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

/// Rows of numbers of a CSV file with one header line.
std::vector<std::vector<double>> read_rows(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  std::vector<std::vector<double>> rows;
  while (std::getline(in, line)) {
    std::stringstream cells(line);
    std::string cell;
    std::vector<double> row;
    while (std::getline(cells, cell, ',')) row.push_back(std::atof(cell.c_str()));
    rows.push_back(std::move(row));
  }
  return rows;
}

/// Heights on a grid of 1 m whose cells may be missing.
class Terrain {
 public:
  explicit Terrain(const RoadCloud& cloud) {
    for (const Vector3f& p : cloud.points) {
      const Vector3d x = cloud.origin + p.cast<double>();
      offset_ = {x.x() - std::floor(x.x()), x.y() - std::floor(x.y())};
      break;
    }
    for (const Vector3f& p : cloud.points) {
      const Vector3d x = cloud.origin + p.cast<double>();
      cells_[key(x.x(), x.y())] = x.z();
    }
  }
  /// Bilinear; NaN outside.
  double height(double x, double y) const {
    const double gx = x - offset_.x(), gy = y - offset_.y();
    const double fx = gx - std::floor(gx), fy = gy - std::floor(gy);
    double sum = 0.0;
    for (int corner = 0; corner < 4; ++corner) {
      const int dx = corner % 2, dy = corner / 2;
      const auto found = cells_.find(key(x - fx + dx, y - fy + dy));
      if (found == cells_.end()) return std::nan("");
      sum += (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy) * found->second;
    }
    return sum;
  }

 private:
  std::pair<long, long> key(double x, double y) const {
    return {std::lround(x - offset_.x()), std::lround(y - offset_.y())};
  }
  Vector2d offset_ = Vector2d::Zero();
  std::map<std::pair<long, long>, double> cells_;
};

/// Slope of heights over `length` around each station, by least squares; NaN at the ends.
std::vector<double> smoothed_grade(const std::vector<double>& station,
                                   const std::vector<double>& height, double length) {
  std::vector<double> out(station.size(), std::nan(""));
  for (std::size_t k = 0; k < station.size(); ++k) {
    if (station[k] - 0.5 * length < station.front() - 1e-6 ||
        station[k] + 0.5 * length > station.back() + 1e-6) {
      continue;
    }
    double n = 0, s = 0, h = 0, ss = 0, sh = 0;
    for (std::size_t j = 0; j < station.size(); ++j) {
      const double d = station[j] - station[k];
      if (std::abs(d) > 0.5 * length + 1e-6) continue;
      n += 1;
      s += d;
      h += height[j];
      ss += d * d;
      sh += d * height[j];
    }
    out[k] = (n * sh - s * h) / (n * ss - s * s);
  }
  return out;
}

/// Noise of a camera that drives along a line, 1.65 m above it, 6 to 30 m before each point.
class CameraNoise {
 public:
  CameraNoise(std::vector<Vector3d> line, std::uint64_t seed)
      : line_(std::move(line)), random_(seed, 31) {}
  Vector3d operator()(const Vector3d& p, double chainage, float* sigma) {
    const double back = random_.uniform(next_++, 6.0, 30.0);
    const double at = std::clamp(chainage - back, 0.0, static_cast<double>(line_.size() - 1));
    Vector3d camera = line_[static_cast<std::size_t>(at)] + Vector3d(0, 0, 1.65);
    // Before the start of the line the camera stands as far behind it.
    if (chainage < back) {
      const Vector3d way = (line_[1] - line_[0]).normalized();
      camera += (chainage - back) * way;
    }
    const Vector3d offset = p - camera;
    const double r = offset.norm();
    const double along = 0.5 * r * r / 718.0, across = 0.5 * r / 718.0;
    Vector3d e1, e2;
    UncertainPlane::make_axes(offset / r, Vector3d::UnitZ(), &e1, &e2);
    *sigma = static_cast<float>(along);
    const double n1 = random_.normal(next_), n2 = random_.normal(next_ + 1),
                 n3 = random_.normal(next_ + 2);
    next_ += 3;
    return p + along * n1 * offset / r + across * (n2 * e1 + n3 * e2);
  }

 private:
  std::vector<Vector3d> line_;
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

void forest_road() {
  std::printf("\n## als-forest-road with camera noise: along the centreline, grade over 10 m\n");
  const fs::path folder = test::data_dir() / "als-forest-road";
  if (!available(folder / "terrain.ply")) return;
  const RoadCloud terrain = read_cloud(folder / "terrain.ply");
  const Terrain grid(terrain);
  std::vector<Vector3d> line;
  std::vector<double> station, truth;
  for (const std::vector<double>& row : read_rows(folder / "centreline.csv")) {
    station.push_back(row[0]);
    line.emplace_back(row[1], row[2], row[3]);
    truth.push_back(row[3]);
  }
  // Stations in plan, as profiles have them.
  std::vector<double> way(1, 0.0);
  for (std::size_t k = 1; k < line.size(); ++k) {
    way.push_back(way.back() + (line[k] - line[k - 1]).head<2>().norm());
  }
  const std::vector<double> true_grade = smoothed_grade(way, truth, 10.0);
  const std::vector<float>& chainage = terrain.scalars.at("chainage");
  const std::vector<float>& distance = terrain.scalars.at("road_distance");
  struct Input {
    const char* name;
    std::size_t points;  ///< 0: every grid cell once
    float width;         ///< cells this near to the centreline
    bool sigmas;
  };
  const Input inputs[] = {
      {"every cell once", 0, 25.0f, false},     {"every cell once", 0, 25.0f, true},
      {"road and verge, once", 0, 6.0f, false}, {"20000 places", 20000, 25.0f, false},
      {"200000 places", 200000, 25.0f, false},  {"200000 places", 200000, 25.0f, true}};
  for (const Input& input : inputs) {
    std::vector<double> grade_errors, height_errors, covered, patch_counts;
    // One scene more or less moves the mean of a few sparse ones by a tenth.
    const std::uint64_t scenes = input.points > 100000 ? 5 : 16;
    for (std::uint64_t seed = 0; seed < scenes; ++seed) {
      RoadCloud cloud;
      cloud.frame = CloudFrame::kZUp;
      CameraNoise noise(line, seed);
      const CounterRandom random(seed, 32);
      const std::size_t cells = terrain.size();
      std::vector<std::size_t> near;
      for (std::size_t i = 0; i < cells; ++i) {
        if (distance[i] <= input.width) near.push_back(i);
      }
      const std::size_t count = input.points > 0 ? input.points : near.size();
      for (std::size_t k = 0; k < count; ++k) {
        std::size_t i = near[k % near.size()];
        Vector3d p;
        if (input.points > 0) {
          i = near[random.below(3 * k, near.size())];
          p = terrain.origin + terrain.points[i].cast<double>();
          p.x() += random.uniform(3 * k + 1) - 0.5;
          p.y() += random.uniform(3 * k + 2) - 0.5;
          p.z() = grid.height(p.x(), p.y());
          if (!std::isfinite(p.z())) continue;
        } else {
          p = terrain.origin + terrain.points[i].cast<double>();
        }
        float sigma = 0.0f;
        cloud.points.push_back(noise(p, static_cast<double>(chainage[i]), &sigma).cast<float>());
        if (input.sigmas) cloud.sigmas.push_back(sigma);
      }
      RoadSurfaceOptions options;
      options.driven_line = line;
      const RoadSurfaceFit fit = fit_road_surface(cloud, options);
      patch_counts.push_back(static_cast<double>(fit.surface.patches.size()));
      const std::vector<ProfilePoint> profile = road_profile(fit.surface, line, {});
      for (const ProfilePoint& point : profile) {
        covered.push_back(point.status != Status::kFailed ? 1.0 : 0.0);
        const auto k = static_cast<std::size_t>(std::lround(point.station));
        if (k >= way.size() || point.status == Status::kFailed) continue;
        // The truth at this very station.
        const std::size_t a = std::min(k, way.size() - 2);
        const double share = (point.station - way[a]) / (way[a + 1] - way[a]);
        const double z = truth[a] + share * (truth[a + 1] - truth[a]);
        height_errors.push_back(std::abs(point.height - z));
        if (std::isfinite(point.grade) && std::isfinite(true_grade[k])) {
          grade_errors.push_back(std::abs(std::atan(point.grade) - std::atan(true_grade[k])) /
                                 kDegree);
        }
      }
    }
    std::printf(
        "%-21s %-6s %5.1f patches, covered %.1f %%; grade error mean %.3f deg (95 %% %.3f, worst "
        "%.3f); height error mean %.1f mm (95 %% %.1f, worst %.1f)\n",
        input.name, input.sigmas ? "sigmas" : "x y z", mean_of(patch_counts),
        100 * mean_of(covered), mean_of(grade_errors), quantile_of(grade_errors, 0.95),
        quantile_of(grade_errors, 1.0), 1e3 * mean_of(height_errors),
        1e3 * quantile_of(height_errors, 0.95), 1e3 * quantile_of(height_errors, 1.0));
  }
}

void city_sweep() {
  std::printf("\n## argoverse2-ground: a sweep against the measured ground\n");
  const fs::path folder = test::data_dir() / "argoverse2-ground" / "adcf7d18";
  const fs::path file = folder / "sweep_315973157959879000.ply";
  if (!available(file)) return;
  const RoadCloud sweep = read_cloud(file);
  const RoadCloud ground = read_cloud(folder / "ground.ply");
  const std::vector<double> pose = read_rows(folder / "sweep_315973157959879000_pose.csv").at(0);
  const Eigen::Quaterniond q(pose[1], pose[2], pose[3], pose[4]);
  const Vector3d t(pose[5], pose[6], pose[7]);
  const std::vector<int>& drivable = ground.labels.at("drivable");
  RoadSurfaceOptions options;
  options.num_threads = 1;
  RoadSurfaceFit fit;
  const double ms = least_ms(5, [&] { fit = fit_road_surface(sweep, options); });
  int road = 0;
  for (const PlanePatch& patch : fit.surface.patches) road += patch.kind == PatchKind::kRoad;
  std::printf("%zu points, %.1f ms, %zu patches, %d of them road\n", sweep.size(), ms,
              fit.surface.patches.size(), road);
  for (const double reach : {20.0, 30.0, 45.0}) {
    for (const bool road_only : {true, false}) {
      std::vector<double> errors, signed_errors;
      double cells = 0;
      for (std::size_t i = 0; i < ground.size(); ++i) {
        if (!drivable[i]) continue;
        const Vector3d world = ground.origin + ground.points[i].cast<double>();
        const Vector3d p = q.inverse() * (world - t);
        if (p.head<2>().norm() > reach) continue;
        cells += 1;
        const SurfaceQuery answer = fit.surface.query(p);
        if (answer.status == Status::kFailed) continue;
        if (road_only && fit.surface.find(answer.patch)->kind != PatchKind::kRoad) continue;
        errors.push_back(std::abs(answer.point.z() - p.z()));
        signed_errors.push_back(answer.point.z() - p.z());
      }
      std::printf(
          "within %2.0f m, %-10s %.0f of %.0f drivable cells covered (%.0f %%): height error "
          "median "
          "%.1f mm, 95 %% %.1f mm, 99 %% %.1f mm; signed median %+.1f mm\n",
          reach, road_only ? "road:" : "any patch:", static_cast<double>(errors.size()), cells,
          100 * static_cast<double>(errors.size()) / cells, 1e3 * quantile_of(errors, 0.5),
          1e3 * quantile_of(errors, 0.95), 1e3 * quantile_of(errors, 0.99),
          1e3 * quantile_of(signed_errors, 0.5));
    }
  }
}

}  // namespace
}  // namespace camber::benchmarks

int main(int argc, char** argv) {
  using namespace camber::benchmarks;
  std::set<std::string> wanted;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--scenes" && i + 1 < argc) {
      g_scenes = static_cast<std::size_t>(std::atol(argv[++i]));
    } else if (word == "--largest" && i + 1 < argc) {
      g_largest = static_cast<std::size_t>(std::atol(argv[++i]));
    } else if (word == "--plot" && i + 1 < argc) {
      g_plot = argv[++i];
    } else {
      wanted.insert(word);
    }
  }
  const auto run = [&](const char* name) { return wanted.empty() || wanted.count(name) > 0; };
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  if (run("plane")) one_plane(1, "One plane, 30 % outliers");
  if (run("largest")) one_plane(6, "Largest of six planes, 30 % outliers");
  if (run("patches")) patches();
  if (run("coverage")) coverage();
  if (run("repeat")) repeat();
  if (run("hill")) hill();
  if (run("real")) {
    forest_road();
    city_sweep();
  }
}
