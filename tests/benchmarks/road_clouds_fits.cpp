// One plane and all planes of made road clouds against their truth and other libraries.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "benchmarks/road_cloud_peers.h"
#include "benchmarks/road_clouds.h"
#include "road/patch_score.h"

namespace camber::benchmarks {
namespace {

using Eigen::Vector3d;
using test::PatchScore;
using test::RoadScene;

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

/// "CLOUD/kind": clouds of one seed share their planes.
std::string cloud_key(std::size_t points, bool sigmas, std::uint64_t seed) {
  return std::to_string(seed) + "/" + count_name(points) + (sigmas ? " sigmas" : " x y z");
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
  void print(const char* name, std::size_t points, bool sigmas, double against,
             bench::Table& table) const {
    table.row({name, count_name(points), sigmas ? "sigmas" : "x y z", mean_of(ms), mean_of(angles),
               quantile_of(angles, 1.0), mean_of(heights), quantile_of(heights, 1.0), same,
               angles.size()});
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

}  // namespace

void one_plane(const Bench& bench, const std::string& section, int planes, const char* title) {
  bench::Table& table = bench.report.table(
      section, title, section,
      {bench::label("library"), bench::label("points"), bench::label("with"), bench::timing("CPU"),
       bench::lower("normal, mean", "deg"), bench::lower("normal, worst", "deg"),
       bench::lower("height, mean", "mm"), bench::lower("height, worst", "mm"),
       bench::higher("largest plane"), bench::value("of")});
  bench::Items& items =
      bench.report.items(section, {bench::lower("normal", "deg"), bench::lower("height", "mm")});
  std::printf("\n## %s\n", title);
  std::printf("CPU time of compute, one thread, mean over scenes of the least of several runs\n");
  for (std::size_t points = 10000; points <= bench.largest; points *= 10) {
    const int scenes = points >= 10000000 ? 2 : points >= 1000000 ? 6 : 20;
    for (const bool sigmas : {false, true}) {
      PlaneErrors ours, ransac, msac;
      for (int seed = 0; seed < scenes; ++seed) {
        const RoadScene scene =
            bench.made_scene(planes, points, sigmas, 1000 + static_cast<std::uint64_t>(seed));
        PlaneFitOptions options = bench.plane_options();
        options.num_threads = 1;
        PlaneFit fit;
        const double ms = least_ms(bench.repeats(repeats_for(points)),
                                   [&] { fit = fit_plane(scene.cloud, options); });
        ours.add(scene, fit.plane.plane, ms);
        items.add(
            cloud_key(points, sigmas, bench.of_cloud(1000 + static_cast<std::uint64_t>(seed))),
            {ours.angles.back(), ours.heights.back()});
        const bool peers = !bench.report.accuracy_only() && !sigmas &&
                           seed < (points >= 1000000 ? 2 : 5) && (planes == 1 || points <= 1000000);
        if (!peers) continue;
        for (const bool use_msac : {false, true}) {
          // Not the least of several runs: PCL's own seed makes every run alike.
          const PeerAnswer answer = pcl_plane(scene.cloud, use_msac, 10000);
          if (!answer.planes.empty()) {
            (use_msac ? msac : ransac).add(scene, answer.planes[0], answer.ms);
          }
        }
      }
      ours.print("Camber", points, sigmas, 0.0, table);
      if (!ransac.ms.empty()) ransac.print("PCL RANSAC", points, sigmas, mean_of(ours.ms), table);
      if (!msac.ms.empty()) msac.print("PCL MSAC", points, sigmas, mean_of(ours.ms), table);
    }
  }
}

namespace {

/// A job's wall time on one thread and on all, against another library's in the same run.
struct ThreadTimes {
  std::vector<double> one, all, peer;

  void row(const std::string& job, const char* name, bench::Table& table) const {
    std::printf("%-24s %.2f ms on one thread, %.2f ms on all (%.2f x)", job.c_str(), mean_of(one),
                mean_of(all), mean_of(one) / mean_of(all));
    if (!peer.empty()) {
      std::printf("; %s %.1f ms (%.1f x)", name, mean_of(peer), mean_of(peer) / mean_of(all));
    }
    std::printf("\n");
    table.row({job, mean_of(one), mean_of(all), mean_of(one) / mean_of(all), mean_of(peer),
               mean_of(peer) / mean_of(all)});
  }
};

struct PatchErrors {
  int scenes = 0, complete = 0, found = 0, planes = 0;
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
  void print(const char* name, int k, std::size_t points, const char* kind,
             bench::Table& table) const {
    table.row({name, std::to_string(k), count_name(points), kind, mean_of(ms), found, planes,
               complete, scenes, mean_of(overlaps), least_overlap, mean_of(angles), worst_angle,
               mean_of(heights), worst_height});
    std::printf(
        "%-22s K=%-2d %-5s %-13s %9.2f ms  %d of %d planes, %d of %d scenes whole, mean IoU %.3f "
        "(worst scene %.3f), %.4f deg (worst %.3f), %.1f mm (worst %.1f)\n",
        name, k, count_name(points).c_str(), kind, mean_of(ms), found, planes, complete, scenes,
        mean_of(overlaps), least_overlap, mean_of(angles), worst_angle, mean_of(heights),
        worst_height);
  }
};

}  // namespace

void patches(const Bench& bench) {
  bench::Table& table = bench.report.table(
      "patches", "Multi-plane patches", "patches",
      {bench::label("library"), bench::label("planes"), bench::label("points"),
       bench::label("with"), bench::timing("CPU"), bench::higher("planes found"),
       bench::value("of planes"), bench::higher("whole scenes"), bench::value("of scenes"),
       bench::higher("IoU, mean"), bench::higher("IoU, worst scene"),
       bench::lower("normal, mean", "deg"), bench::lower("normal, worst", "deg"),
       bench::lower("height, mean", "mm"), bench::lower("height, worst", "mm")});
  bench::Items& items =
      bench.report.items("patches", {bench::higher("planes found"), bench::higher("IoU"),
                                     bench::lower("normal", "deg"), bench::lower("height", "mm"),
                                     bench::value("patches that are road")});
  std::printf("\n## Multi-plane patches\n");
  std::printf("CPU time of compute, one thread, mean over scenes of the least of several runs\n");
  bool missing = false;
  for (const int k : {1, 3, 6, 12}) {
    for (std::size_t points = 10000; points <= bench.largest; points *= 10) {
      const int scenes = points >= 10000000 ? 1 : points >= 1000000 ? 4 : 20;
      for (const bool sigmas : {false, true}) {
        PatchErrors ours, cgal;
        double normals = 0.0;
        for (int seed = 0; seed < scenes; ++seed) {
          const RoadScene scene =
              bench.made_scene(k, points, sigmas, 2000 + static_cast<std::uint64_t>(seed));
          RoadSurfaceOptions options = bench.surface_options();
          options.num_threads = 1;
          RoadSurfaceFit fit;
          const int repeats = bench.repeats(points >= 1000000 ? 2 : 5);
          const double ms =
              least_ms(repeats, [&] { fit = fit_road_surface(scene.cloud, options); });
          const PatchScore score = test::score_patches(scene, planes_of(fit.surface), fit.labels);
          ours.add(score, k, ms);
          int road = 0;
          for (const PlanePatch& p : fit.surface.patches) road += p.kind == PatchKind::kRoad;
          items.add(
              cloud_key(points, sigmas, bench.of_cloud(2000 + static_cast<std::uint64_t>(seed))) +
                  " K=" + std::to_string(k),
              {static_cast<double>(score.found), score.mean_overlap, score.mean_angle / kDegree,
               1e3 * score.mean_height, static_cast<double>(road)});
          if (bench.report.accuracy_only() || sigmas || k == 1 || points != 100000 || seed >= 3)
            continue;
          const PeerAnswer answer = cgal_planes(scene.cloud, points / 100);
          missing = missing || !answer.available;
          if (!answer.available) continue;
          cgal.add(test::score_patches(scene, answer.planes, answer.labels), k,
                   answer.ms + answer.normals_ms);
          normals += answer.normals_ms / 3.0;
        }
        ours.print("Camber", k, points, sigmas ? "sigmas" : "x y z", table);
        if (cgal.scenes > 0) {
          cgal.print("CGAL Efficient RANSAC", k, points, "x y z", table);
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

void threads(const Bench& bench) {
  if (bench.report.accuracy_only()) return;  // times alone
  bench::Table& table = bench.report.table(
      "threads", "Wall time on one thread and on all", "threads",
      {bench::label("job"), bench::timing("one thread"), bench::timing("all threads"),
       bench::value("times as fast"), bench::timing("peer"),
       bench::value("peer's time over that of all threads")});
  std::printf(
      "\n## Wall time on one thread and on all\nMean over scenes of the least of several\n");
  ThreadTimes plane, patches;
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    const RoadScene scene = bench.made_scene(1, 1000000, false, 1000 + seed);
    PlaneFitOptions options = bench.plane_options();
    options.list_inliers = false;  // as camber plane
    const auto least = [&](int num_threads) {
      options.num_threads = num_threads;
      return least_wall_ms(100, [&] { fit_plane(scene.cloud, options); });
    };
    plane.one.push_back(least(1));
    plane.all.push_back(least(0));
    plane.peer.push_back(pcl_plane(scene.cloud, false, 10000).ms);
  }
  plane.row("one plane, 1e6 points", "PCL RANSAC", table);
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    const RoadScene scene = bench.made_scene(12, 100000, false, 2000 + seed);
    RoadSurfaceOptions options = bench.surface_options();
    const auto least = [&](int num_threads) {
      options.num_threads = num_threads;
      return least_wall_ms(10, [&] { fit_road_surface(scene.cloud, options); });
    };
    patches.one.push_back(least(1));
    patches.all.push_back(least(0));
    const PeerAnswer answer = cgal_planes(scene.cloud, scene.cloud.size() / 100);
    if (answer.available) patches.peer.push_back(answer.ms + answer.normals_ms);
  }
  patches.row("12 planes, 1e5 points", "CGAL Efficient RANSAC", table);
}

}  // namespace camber::benchmarks
