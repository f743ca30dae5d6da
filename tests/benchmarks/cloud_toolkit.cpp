// Cloud toolkit against its bars and against other libraries: ground, comparison, filters, readers,
// and results of the main job against dense truth. Accuracy beside the time; CPU time of one
// thread, the least of several runs. Prints its tables. Run with no arguments, or the names of
// parts; --help lists them. The seed is that of every made cloud and of reconstruct().

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>

#include "benchmarks/cloud_toolkit_peers.h"
#include "benchmarks/cpu_time.h"
#include "benchmarks/report.h"
#include "camber/cloud/cloud_io.h"
#include "camber/cloud/filters.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/random.h"
#include "camber/evaluate/compare.h"
#include "camber/evaluate/triangle_tree.h"
#include "camber/import/import_kitti.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/road/segment_ground.h"
#include "camber/scene/scene.h"
#include "plane/road_scene_maker.h"
#include "road/scan_maker.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kDegree = M_PI / 180.0;

double wall_ms() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double, std::milli>(now).count();
}

double least_wall_ms(int runs, const std::function<void()>& job) {
  double least = 1e300;
  for (int i = 0; i < runs; ++i) {
    const double start = wall_ms();
    job();
    least = std::min(least, wall_ms() - start);
  }
  return least;
}

double least_ms(int runs, const std::function<void()>& job) {
  double least = 1e300;
  for (int i = 0; i < runs; ++i) {
    const double start = bench::cpu_ms();
    job();
    least = std::min(least, bench::cpu_ms() - start);
  }
  return least;
}

/// Of a made cloud: `seed` for the report's seed 0, far from all others for every other one.
std::uint64_t of_cloud(const bench::Report& report, std::uint64_t seed) {
  return seed + 100000 * report.seed();
}

int repeats(const bench::Report& report, int times) { return report.accuracy_only() ? 1 : times; }

GroundOptions one_thread() {
  GroundOptions options;
  options.num_threads = 1;
  return options;
}

void made_scans(bench::Report& report) {
  bench::Table& table = report.table(
      "ground.scans", "Ground, made 64-beam scans, 10 a row", "ground",
      {bench::label("hills"), bench::higher("F1, mean"), bench::higher("F1, worst"),
       bench::timing("CPU"), bench::timing("wall, all threads"), bench::value("points")});
  bench::Items& items = report.items("ground.scans", {bench::higher("F1")});
  std::printf("\n## Ground, made 64-beam scans (bar: F1 0.965, 10 ms), 10 scans each\n");
  for (const double grade : {0.0, 6.0, 12.0}) {
    double f1 = 0.0, worst = 1.0, time = 0.0, wall = 0.0, points = 0.0;
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      test::ScanOptions made;
      made.seed = of_cloud(report, seed);
      made.grade = grade * kDegree;
      const test::Scan scan = test::make_scan(made);
      GroundSegmentation found;
      time +=
          least_ms(repeats(report, 7), [&] { found = segment_ground(scan.cloud, one_thread()); }) /
          10.0;
      wall += least_wall_ms(repeats(report, 7), [&] { found = segment_ground(scan.cloud); }) / 10.0;
      const double score = test::score_ground(scan.ground, found.labels).f1;
      f1 += score / 10.0;
      worst = std::min(worst, score);
      char hills[32];
      std::snprintf(hills, sizeof hills, "/%.0f deg", grade);
      items.add(std::to_string(made.seed) + hills, {score});
      points += static_cast<double>(scan.cloud.size()) / 10.0;
    }
    std::printf(
        "hills of %4.1f deg: mean F1 %.4f, worst %.4f; %.2f ms (all threads, wall %.2f) for %.0f "
        "points\n",
        grade, f1, worst, time, wall, points);
    char hills[32];
    std::snprintf(hills, sizeof hills, "%.0f deg", grade);
    table.row({hills, f1, worst, time, wall, points});
  }
}

void camera_clouds(bench::Report& report) {
  bench::Items& items = report.items("ground.camera", {bench::higher("F1, pavements are ground"),
                                                       bench::higher("F1, road alone")});
  std::printf(
      "\n## Ground, camera clouds of 1e5 points, six planes, 30 %% outliers (bar: 0.92, 50 ms)\n");
  double road_f1 = 0.0, ground_f1 = 0.0, time = 0.0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    test::RoadSceneOptions made;
    made.seed = of_cloud(report, seed);
    made.planes = 6;
    made.points = 100000;
    const test::RoadScene scene = test::make_road_scene(made);
    GroundSegmentation found;
    time +=
        least_ms(repeats(report, 7), [&] { found = segment_ground(scene.cloud, one_thread()); }) /
        10.0;
    std::vector<int> road(scene.truth.size()), all(scene.truth.size());
    for (std::size_t i = 0; i < road.size(); ++i) {
      road[i] = scene.truth[i] >= 0 ? 1 : 0;
      all[i] = road[i] == 1 || scene.kinds[i] == test::PointSourceKind::kPavement ? 1 : 0;
    }
    const double road_score = test::score_ground(road, found.labels).f1,
                 ground_score = test::score_ground(all, found.labels).f1;
    road_f1 += road_score / 10.0;
    ground_f1 += ground_score / 10.0;
    items.add(std::to_string(made.seed), {ground_score, road_score});
  }
  std::printf("mean F1 %.4f with pavements as ground, %.4f with the road alone; %.2f ms\n",
              ground_f1, road_f1, time);
  report
      .table("ground.camera", "Ground, camera clouds of 1e5 points, six planes, 30 % outliers",
             "ground",
             {bench::higher("F1, pavements are ground"), bench::higher("F1, road alone"),
              bench::timing("CPU")})
      .row({ground_f1, road_f1, time});
}

void isprs_samples(bench::Report& report) {
  bench::Table& table = report.table(
      "ground.isprs", "Ground, ISPRS filter test: total error", "ground",
      {bench::label("sample"), bench::lower("total", "%"), bench::lower("ground lost", "%"),
       bench::lower("others taken", "%"), bench::timing("CPU"), bench::value("PCL, total", "%"),
       bench::timing("PCL, CPU")});
  std::printf(
      "\n## Ground, ISPRS filter test: total error, beside PCL's progressive morphological "
      "filter\n");
  const fs::path data = test::data_dir() / "isprs-filter-terrain";
  if (!fs::exists(data)) {
    std::printf("no data: %s\n", data.c_str());
    return;
  }
  double ours = 0.0, theirs = 0.0;
  for (const char* sample : {"11", "21", "23", "41", "51", "53", "61"}) {
    const std::string base = (data / ("samp" + std::string(sample) + "-utm")).string();
    const RoadCloud all = read_cloud(base + ".pcd"), marked = read_cloud(base + "-ground.pcd");
    using Place = std::array<double, 3>;
    const auto place = [](const RoadCloud& cloud, std::size_t i) {
      const Eigen::Vector3d p = cloud.origin + cloud.points[i].cast<double>();
      return Place{p.x(), p.y(), p.z()};
    };
    std::vector<Place> truth;
    for (std::size_t i = 0; i < marked.size(); ++i) truth.push_back(place(marked, i));
    std::sort(truth.begin(), truth.end());
    GroundSegmentation found;
    const double time_ms =
        least_ms(repeats(report, 3), [&] { found = segment_ground(all, one_thread()); });
    std::vector<int> peer(all.size(), 0);
    const double peer_ms = report.accuracy_only() ? 0.0 : peers::pcl_morphological(all, peer);
    double lost = 0.0, taken = 0.0, is_ground = 0.0, peer_wrong = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const bool ground_here = std::binary_search(truth.begin(), truth.end(), place(all, i));
      is_ground += ground_here ? 1.0 : 0.0;
      lost += ground_here && found.labels[i] == 0 ? 1.0 : 0.0;
      taken += !ground_here && found.labels[i] == 1 ? 1.0 : 0.0;
      peer_wrong += ground_here != (peer[i] == 1) ? 1.0 : 0.0;
    }
    const double n = static_cast<double>(all.size());
    std::printf(
        "sample %s: total %5.2f %% (ground lost %5.2f %%, others taken %5.2f %%), %.1f ms; "
        "PCL %5.2f %%, %.0f ms\n",
        sample, 100 * (lost + taken) / n, 100 * lost / is_ground, 100 * taken / (n - is_ground),
        time_ms, 100 * peer_wrong / n, peer_ms);
    table.row({sample, 100 * (lost + taken) / n, 100 * lost / is_ground,
               100 * taken / (n - is_ground), time_ms,
               report.accuracy_only() ? std::nan("") : 100 * peer_wrong / n, peer_ms});
    ours += (lost + taken) / n / 7;
    theirs += peer_wrong / n / 7;
  }
  std::printf("mean: %.2f %%; PCL %.2f %%\n", 100 * ours, 100 * theirs);
  report
      .table("ground.isprs.mean", "Ground, ISPRS filter test: mean total error of seven samples",
             "ground", {bench::lower("camber", "%"), bench::value("PCL", "%")})
      .row({100 * ours, report.accuracy_only() ? std::nan("") : 100 * theirs});
}

void ground(bench::Report& report) {
  made_scans(report);
  camera_clouds(report);
  isprs_samples(report);
}

double hill(double x, double y) { return 2.0 * std::sin(x / 20.0) + std::cos(y / 11.0); }

/// Points of a hilly square of 120 m, noise along z; a share of them far off, in a box of 300 m.
RoadCloud make_hill(std::size_t count, std::uint64_t seed, double noise, double far_share) {
  RoadCloud cloud;
  const CounterRandom random(seed);
  cloud.points.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    if (random.uniform(8 * i) < far_share) {
      cloud.points.push_back(Eigen::Vector3d(random.uniform(8 * i + 1, -150, 150),
                                             random.uniform(8 * i + 2, -150, 150),
                                             random.uniform(8 * i + 3, -150, 150))
                                 .cast<float>());
      continue;
    }
    const double x = random.uniform(8 * i + 1, -60, 60), y = random.uniform(8 * i + 2, -60, 60);
    cloud.points.push_back(
        Eigen::Vector3d(x, y, hill(x, y) + noise * random.normal(i)).cast<float>());
  }
  return cloud;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

/// A library's time and largest difference to what is true.
bench::Table& distance_table(bench::Report& report, const std::string& key,
                             const std::string& title) {
  return report.table(key, title, "compare",
                      {bench::label("library"), bench::timing("CPU"),
                       bench::lower("largest difference to brute force or camber", "m")});
}

void print_peer(const peers::PeerDistances& peer, double ours_ms, const std::vector<double>& ours,
                bench::Table& table) {
  if (peer.milliseconds < 0.0) {
    std::printf("%s is not installed: no comparison with it\n", peer.name.c_str());
    return;
  }
  std::printf("%s: %.0f ms (%.1f times); largest difference to camber %.1e m\n", peer.name.c_str(),
              peer.milliseconds, peer.milliseconds / ours_ms,
              largest_difference(peer.distances, ours));
  table.row({peer.name, peer.milliseconds, largest_difference(peer.distances, ours)});
}

constexpr std::size_t kPoints = 1000000;

void compare_clouds(bench::Report& report, const RoadCloud& estimate,
                    const std::vector<Eigen::Vector3d>& places) {
  Shape truth{make_hill(kPoints, of_cloud(report, 2), 0.0, 0.0), {}};
  bench::Table& table =
      distance_table(report, "compare.cloud",
                     "Cloud to cloud, 1e6 to 1e6 points, 30 % far outliers, index included");
  std::printf(
      "\n## Cloud to cloud, 1e6 to 1e6 points, 30 %% far outliers, index included (bar: 3 s)\n");
  ShapeDistances found;
  const double ours = least_ms(repeats(report, 3), [&] { found = distances_to(truth, places, 1); });
  double worst = 0.0;
  for (std::size_t i = 0; i < kPoints; i += 10007) {
    double least = 1e300;
    for (const Eigen::Vector3f& p : truth.cloud.points) {
      least = std::min(least, (p.cast<double>() - places[i]).squaredNorm());
    }
    worst = std::max(worst, std::abs(std::sqrt(least) - found.distance[i]));
  }
  std::printf("camber: %.0f ms; largest difference to brute force %.1e m (100 points)\n", ours,
              worst);
  table.row({"camber", ours, worst});
  if (report.accuracy_only()) return;
  for (const auto& peer :
       {peers::nanoflann_nearest(estimate, truth.cloud),
        peers::open3d_nearest(estimate, truth.cloud), peers::flann_nearest(estimate, truth.cloud),
        peers::pcl_nearest(estimate, truth.cloud)}) {
    print_peer(peer, ours, found.distance, table);
  }
}

void compare_mesh(bench::Report& report, const std::vector<Eigen::Vector3d>& places) {
  Shape mesh;
  constexpr int kSide = 148;
  for (int j = 0; j < kSide; ++j) {
    for (int i = 0; i < kSide; ++i) {
      const double x = -60.0 + 120.0 * i / (kSide - 1), y = -60.0 + 120.0 * j / (kSide - 1);
      mesh.cloud.points.push_back(Eigen::Vector3d(x, y, hill(x, y)).cast<float>());
      if (i == 0 || j == 0) continue;
      const auto at = [](int a, int b) { return static_cast<std::uint32_t>(b * kSide + a); };
      mesh.triangles.push_back({at(i - 1, j - 1), at(i, j - 1), at(i, j)});
      mesh.triangles.push_back({at(i - 1, j - 1), at(i, j), at(i - 1, j)});
    }
  }
  std::printf("\n## Cloud to mesh, the same 1e6 points to %zu triangles (bar: 2 s)\n",
              mesh.triangles.size());
  ShapeDistances found;
  const double mesh_ms =
      least_ms(repeats(report, 3), [&] { found = distances_to(mesh, places, 1); });
  const std::vector<Eigen::Vector3d> corners = true_points(mesh.cloud);
  double worst = 0.0;
  for (std::size_t i = 0; i < kPoints; i += 2003) {
    double least = 1e300;
    for (const auto& t : mesh.triangles) {
      least = std::min(
          least,
          (nearest_on_triangle(places[i], corners[t[0]], corners[t[1]], corners[t[2]]) - places[i])
              .norm());
    }
    worst = std::max(worst, std::abs(least - found.distance[i]));
  }
  std::printf("camber: %.0f ms; largest difference to brute force %.1e m (500 points)\n", mesh_ms,
              worst);
  bench::Table& table = distance_table(
      report, "compare.mesh",
      "Cloud to mesh, 1e6 points to " + std::to_string(mesh.triangles.size()) + " triangles");
  table.row({"camber", mesh_ms, worst});
  if (report.accuracy_only()) return;
  for (const auto& peer : {peers::open3d_mesh_distance(places, corners, mesh.triangles),
                           peers::cgal_mesh_distance(places, corners, mesh.triangles)}) {
    print_peer(peer, mesh_ms, found.distance, table);
  }
}

void compare(bench::Report& report) {
  const RoadCloud estimate = make_hill(kPoints, of_cloud(report, 1), 0.05, 0.3);
  const std::vector<Eigen::Vector3d> places = true_points(estimate);
  compare_clouds(report, estimate, places);
  compare_mesh(report, places);
}

void normals(bench::Report& report, const RoadCloud& cloud) {
  bench::Table& table = report.table(
      "filters.normals", "Normals, k = 20, 1e6 points in random order", "filters",
      {bench::label("library"), bench::timing("CPU"), bench::lower("error, median", "deg")});
  std::printf("\n## Normals, k = 20, 1e6 points in random order (bar: 2.5 s)\n");
  RoadCloud with_normals = cloud;
  NormalOptions normals;
  normals.num_threads = 1;
  const double ours =
      least_ms(repeats(report, 3), [&] { estimate_normals(with_normals, normals); });
  const auto error = [&](const std::vector<Eigen::Vector3f>& found) {
    std::vector<double> angles;
    for (std::size_t i = 0; i < found.size(); i += 10) {
      const double x = cloud.points[i].x(), y = cloud.points[i].y();
      const Eigen::Vector3d truth =
          Eigen::Vector3d(-0.1 * std::cos(x / 20.0), std::sin(y / 11.0) / 11.0, 1.0).normalized();
      angles.push_back(
          std::acos(std::clamp(std::abs(truth.dot(found[i].cast<double>())), 0.0, 1.0)) / kDegree);
    }
    std::nth_element(angles.begin(),
                     angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2), angles.end());
    return angles[angles.size() / 2];
  };
  std::printf("camber: %.0f ms; median error %.3f deg\n", ours, error(with_normals.normals));
  table.row({"camber", ours, error(with_normals.normals)});
  if (report.accuracy_only()) return;
  using Job = double (*)(const RoadCloud&, int, std::vector<Eigen::Vector3f>&);
  for (const auto& [name, job] : {std::pair<const char*, Job>{"PCL", peers::pcl_normals},
                                  {"nanoflann with Eigen", peers::nanoflann_normals},
                                  {"Open3D", peers::open3d_normals}}) {
    std::vector<Eigen::Vector3f> found;
    const double time = job(cloud, 20, found);
    if (time < 0.0) {
      std::printf("%s is not installed: no comparison with it\n", name);
      continue;
    }
    std::printf("%s: %.0f ms (%.1f times); median error %.3f deg\n", name, time, time / ours,
                error(found));
    table.row({name, time, error(found)});
  }
}

void voxels(bench::Report& report, const RoadCloud& cloud) {
  std::printf("\n## Voxel grid of 0.2 m, 1e6 points (bar: 60 ms)\n");
  RoadCloud thinned;
  const double thin_ms = least_ms(repeats(report, 5), [&] { thinned = thin(cloud, 0.2); });
  std::size_t left = 0;
  double voxel_ms = 1e300;
  for (int i = 0; i < repeats(report, 3); ++i) {
    voxel_ms = std::min(voxel_ms, peers::pcl_voxel_grid(cloud, 0.2f, left));
  }
  std::printf("camber: %.1f ms, %zu points left; PCL: %.1f ms (%.1f times), %zu left\n", thin_ms,
              thinned.size(), voxel_ms, voxel_ms / thin_ms, left);
  bench::Table& table =
      report.table("filters.voxels", "Voxel grid of 0.2 m, 1e6 points", "filters",
                   {bench::label("library"), bench::timing("CPU"), bench::value("points left")});
  table.row({"camber", thin_ms, thinned.size()});
  table.row({"PCL", voxel_ms, left});
}

void statistical_outliers(bench::Report& report) {
  std::printf(
      "\n## Statistical outliers, k = 20, 1e5 points, 5 %% of them far off (bar: 200 ms)\n");
  const RoadCloud noisy = make_hill(100000, of_cloud(report, 4), 0.02, 0.05);
  std::vector<int> kept, peer_kept;
  const double statistical_ms =
      least_ms(repeats(report, 5), [&] { kept = statistical_inliers(noisy, 20, 1.0, 1); });
  double peer_ms = 1e300;
  for (int i = 0; i < repeats(report, 3); ++i) {
    peer_ms = std::min(peer_ms, peers::pcl_statistical(noisy, 20, 1.0, peer_kept));
  }
  std::vector<int> differing;
  std::set_symmetric_difference(kept.begin(), kept.end(), peer_kept.begin(), peer_kept.end(),
                                std::back_inserter(differing));
  std::printf(
      "camber: %.1f ms, %zu kept; PCL: %.1f ms (%.1f times), %zu kept, %zu decided otherwise\n",
      statistical_ms, kept.size(), peer_ms, peer_ms / statistical_ms, peer_kept.size(),
      differing.size());
  bench::Table& table =
      report.table("filters.outliers",
                   "Statistical outliers, k = 20, 1e5 points, 5 % of them far off", "filters",
                   {bench::label("library"), bench::timing("CPU"), bench::value("points kept"),
                    bench::lower("decided otherwise than camber")});
  table.row({"camber", statistical_ms, kept.size(), 0});
  table.row({"PCL", peer_ms, peer_kept.size(), differing.size()});
}

void filters(bench::Report& report) {
  const RoadCloud cloud = make_hill(1000000, of_cloud(report, 3), 0.02, 0.0);
  normals(report, cloud);
  voxels(report, cloud);
  statistical_outliers(report);
}

/// Processor time of `cat FILE | cat > /dev/null`, ms.
double cat_ms(const fs::path& file) {
  rusage before{}, after{};
  getrusage(RUSAGE_CHILDREN, &before);
  const std::string command = "cat '" + file.string() + "' | cat > /dev/null";
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", command.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  int status = 0;
  waitpid(child, &status, 0);
  getrusage(RUSAGE_CHILDREN, &after);
  const auto ms = [](const timeval& t) {
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_usec);
  };
  return ms(after.ru_utime) + ms(after.ru_stime) - ms(before.ru_utime) - ms(before.ru_stime);
}

void read(bench::Report& report) {
  if (report.accuracy_only()) return;  // times alone
  bench::Table& binary = report.table(
      "read.binary", "Reading 1e7 points, processor time against that of `cat FILE | cat`", "read",
      {bench::label("file"), bench::value("size", "MB"), bench::timing("camber"),
       bench::timing("cat"), bench::timing("ratio", ""), bench::value("points")});
  bench::Table& text = report.table(
      "read.ascii", "Reading ASCII, 1e6 points", "read",
      {bench::label("file"), bench::value("size", "MB"), bench::timing("speed", "MB/s")});
  std::printf(
      "\n## Reading 1e7 points (bar: 1.7 times `cat FILE | cat > /dev/null`; ASCII 100 MB/s)\n");
  test::TemporaryFolder folder;
  {
    const RoadCloud cloud = make_hill(10000000, of_cloud(report, 5), 0.02, 0.0);
    write_cloud(cloud, folder.path() / "cloud.ply");
    write_cloud(cloud, folder.path() / "cloud.pcd");
  }
  for (const char* name : {"cloud.ply", "cloud.pcd"}) {
    const fs::path file = folder.path() / name;
    const double megabytes = 1e-6 * static_cast<double>(fs::file_size(file));
    // Taken in turn, so that both see the same machine.
    double cat = 1e300, ours = 1e300;
    std::size_t points = 0;
    for (int i = 0; i < 7; ++i) {
      cat = std::min(cat, cat_ms(file));
      ours = std::min(ours, least_ms(1, [&] { points = read_cloud(file).size(); }));
    }
    std::printf("%s, %.0f MB: camber %.1f ms, cat %.1f ms, ratio %.2f (%zu points)\n", name,
                megabytes, ours, cat, ours / cat, points);
    binary.row({name, megabytes, ours, cat, ours / cat, points});
  }
  const RoadCloud some = make_hill(1000000, of_cloud(report, 6), 0.02, 0.0);
  WriteOptions ascii;
  ascii.encoding = CloudEncoding::kAscii;
  write_cloud(some, folder.path() / "ascii.ply", ascii);
  write_cloud(some, folder.path() / "ascii.pcd", ascii);
  write_cloud(some, folder.path() / "ascii.xyz");
  write_cloud(some, folder.path() / "ascii.csv");
  for (const char* name : {"ascii.ply", "ascii.pcd", "ascii.xyz", "ascii.csv"}) {
    const fs::path file = folder.path() / name;
    const double megabytes = 1e-6 * static_cast<double>(fs::file_size(file));
    const double time = least_ms(5, [&] { read_cloud(file); });
    std::printf("%s, %.1f MB: %.0f MB/s\n", name, megabytes, 1e3 * megabytes / time);
    text.row({name, megabytes, 1e3 * megabytes / time});
  }
}

void result_against(bench::Report& report, const std::string& key, const char* name,
                    const Reconstruction& result, const Scene& scene, const Shape& truth,
                    CompareOptions options) {
  std::printf("\n%s: %zu estimated points, %zu of the truth\n", name, result.cloud.size(),
              truth.cloud.size());
  options.up = {0, -1, 0};
  options.along = {0, 0, 1};
  options.viewpoint = Eigen::Vector3d::Zero();
  for (const RunDocument::CameraPose& pose : result.run.cameras) {
    options.views.push_back({scene.camera, pose.reference_from_camera.inverse()});
  }
  const CloudComparison found = compare_shapes({result.cloud, {}}, truth, options);
  std::printf("%s", describe(found).c_str());
  bench::Table& scores = report.table(
      key + ".scores", std::string(name) + ": share of points near the truth", "results",
      {bench::label("within"), bench::higher("precision", "%"), bench::higher("recall", "%"),
       bench::higher("F-score", "%")});
  for (const ThresholdScore& score : found.scores) {
    char within[16];
    std::snprintf(within, sizeof within, "%g m", score.threshold);
    scores.row({within, 100 * score.precision, 100 * score.recall, 100 * score.f_score});
  }
  bench::Table& heights = report.table(
      key + ".heights", std::string(name) + ": heights above the truth", "results",
      {bench::label("distance"), bench::value("points"), bench::value("mean, up is positive", "m"),
       bench::lower("median, absolute", "m"), bench::lower("rms", "m")});
  for (const RoadErrors& errors : found.road) {
    if (errors.by != "distance" || errors.count == 0) continue;
    char distance[48];
    std::snprintf(distance, sizeof distance, "%g to %g m", errors.from, errors.to);
    heights.row(
        {distance, errors.count, errors.height_mean, errors.height_median, errors.height_rms});
  }
}

void sample_result(bench::Report& report, const ReconstructOptions& run) {
  const Scene scene = read_scene(test::source_dir() / "samples" / "steep_hill");
  const Reconstruction result = reconstruct(scene, select_frames(scene, ""), run);
  Shape truth;
  truth.cloud = read_cloud(scene.truth->cloud);
  CompareOptions options;
  options.seed = report.seed();
  const auto pose = [&](int id) {
    for (const TruthFrame& frame : scene.truth->frames) {
      if (frame.id == id && frame.world_from_camera) return *frame.world_from_camera;
    }
    return SE3();
  };
  SE3 world_from_cloud;
  if (scene.truth->cloud_frame) world_from_cloud = pose(*scene.truth->cloud_frame);
  options.estimate_from_truth =
      (pose(result.reference_frame).inverse() * world_from_cloud).matrix();
  result_against(report, "results.steep_hill", "samples/steep_hill", result, scene, truth, options);
}

void drive_result(bench::Report& report, const ReconstructOptions& run) {
  const fs::path folder = test::data_dir() / "kitti-raw-2011_09_26-drive_0052";
  if (!fs::exists(folder)) {
    std::printf("no data: %s\n", folder.c_str());
    return;
  }
  test::TemporaryFolder temporary;
  KittiImportOptions import;
  import.images = folder / "image_02";
  import.calibration = {folder / "calib.txt"};
  import.poses = folder / "poses_from_lidar.txt";
  import.velodyne = folder / "velodyne";
  import.frames = "0:10:5";
  import.camera = 2;
  const fs::path manifest = temporary.path() / "scene.json";
  import_kitti_to(import, manifest);
  const Scene scene = read_scene(manifest);
  const Reconstruction result = reconstruct(scene, {0, 5, 10}, run);
  Shape truth;
  truth.cloud = read_cloud(scene.truth->cloud);
  CompareOptions options;
  options.seed = report.seed();
  options.thresholds = {0.1, 0.2, 0.5};
  // The scan of the reference frame, in its camera: what was seen from the laser, above the camera.
  options.truth_viewpoint = Eigen::Vector3d(0.06, -0.08, -0.27);
  const GroundSegmentation is_ground = [&] {
    GroundOptions ground_options;
    ground_options.up = {0, -1, 0};
    return segment_ground(truth.cloud, ground_options);
  }();
  std::vector<int> kept;
  for (std::size_t i = 0; i < truth.cloud.size(); ++i) {
    if (is_ground.labels[i] == 1) kept.push_back(static_cast<int>(i));
  }
  truth.cloud = truth.cloud.select(kept);
  result_against(report, "results.drive_0052",
                 "KITTI raw drive 0052, frames 0, 5, 10, against the ground of the laser's scan",
                 result, scene, truth, options);
}

void results(bench::Report& report) {
  std::printf("\n## camber reconstruct against dense truth\n");
  ReconstructOptions run;
  run.seed = report.seed();
  sample_result(report, run);
  drive_result(report, run);
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using camber::bench::Report;
  const camber::bench::Program program = {
      "bench_cloud_toolkit",
      "Cloud toolkit against its bars and other libraries, results against dense truth",
      {"ground", "compare", "filters", "read", "results"},
      {}};
  return camber::bench::run_program(program, argc, argv, [](Report& report) {
    const auto run = [&](const char* name, void (*part)(Report&)) {
      if (report.wanted(name)) part(report);
      std::fflush(stdout);
    };
    run("ground", camber::ground);
    run("compare", camber::compare);
    run("filters", camber::filters);
    run("read", camber::read);
    run("results", camber::results);
  });
}
