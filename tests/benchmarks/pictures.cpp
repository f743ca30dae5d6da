// Times of pictures: a million points by the program without a display, and overlays of one frame.
// Prints its table. The seed is that of the points.

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "benchmarks/cpu_time.h"
#include "benchmarks/report.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/render/overlay.h"
#include "camber/render/picture_file.h"
#include "render/picture_content.h"
#include "support/test_data.h"

namespace {

using namespace camber;

struct Times {
  double wall = 1e30, cpu = 1e30;  // s, least of all runs
};

/// Runs the program; its time on the wall and on all processors.
Times time_program(const std::vector<std::string>& words, int repeats) {
  Times best;
  for (int i = 0; i < repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const pid_t child = ::fork();
    if (child == 0) {
      ::unsetenv("DISPLAY");
      std::vector<char*> argv;
      for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
      argv.push_back(nullptr);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    int status = 0;
    rusage usage{};
    ::wait4(child, &status, 0, &usage);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
      throw MachineError(words[0] + " " + words[1] + " failed");
    }
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    const auto seconds = [](const timeval& t) { return t.tv_sec + 1e-6 * t.tv_usec; };
    best.wall = std::min(best.wall, wall.count());
    best.cpu = std::min(best.cpu, seconds(usage.ru_utime) + seconds(usage.ru_stime));
  }
  return best;
}

/// A road of 100 m x 24 m that rises and bends, with 3 cm of noise.
RoadCloud make_road(std::size_t count, std::uint64_t seed) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  const CounterRandom random(1 + seed);
  cloud.points.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double x = random.uniform(2 * i, 0.0, 24.0), y = random.uniform(2 * i + 1, 0.0, 100.0);
    const double z = 0.06 * y + 2.0 * std::sin(0.05 * y) + 0.03 * random.normal(i);
    cloud.points.emplace_back(static_cast<float>(x - 12.0), static_cast<float>(y),
                              static_cast<float>(z));
  }
  return cloud;
}

template <typename Job>
double least_cpu_ms(int repeats, Job job) {
  double best = 1e30;
  for (int i = 0; i < repeats; ++i) {
    const double start = bench::cpu_ms();
    job();
    best = std::min(best, bench::cpu_ms() - start);
  }
  return best;
}

void programs(bench::Report& report, int repeats) {
  const test::TemporaryFolder folder;
  const std::string cloud = (folder.path() / "million.ply").string();
  const std::string out = (folder.path() / "out.png").string();
  write_cloud(make_road(1000000, report.seed()), cloud);
  std::printf("camber render, 1,000,000 points, no display, least of %d runs\n", repeats);
  std::printf("  %-34s %8s %8s\n", "", "wall s", "CPU s");
  bench::Table& table = report.table(
      "render", "camber render, 1,000,000 points, no display, reading and PNG included", "",
      {bench::label("picture"), bench::timing("wall", "s"), bench::timing("CPU", "s")});
  struct Row {
    const char* name;
    std::vector<std::string> words;
  };
  const std::vector<Row> rows = {
      {"1920x1080, oblique and side", {"--size", "1920x1080"}},
      {"1920x1080, oblique", {"--size", "1920x1080", "--view", "oblique"}},
      {"1920x1080, bird's eye", {"--size", "1920x1080", "--view", "bev"}},
      {"7680x4320, oblique", {"--size", "7680x4320", "--view", "oblique"}},
  };
  for (const Row& row : rows) {
    std::vector<std::string> words = {CAMBER_PROGRAM, "render", cloud, "--out", out, "--quiet"};
    words.insert(words.end(), row.words.begin(), row.words.end());
    const Times times =
        time_program(words, row.words[1] == "7680x4320" ? std::min(repeats, 2) : repeats);
    std::printf("  %-34s %8.2f %8.2f\n", row.name, times.wall, times.cpu);
    table.row({row.name, times.wall, times.cpu});
  }
}

void overlays(bench::Report& report, int repeats) {
  test::PictureScene scene;
  VehicleFrame frame;
  frame.id = 7;
  for (int i = 0; i < 10; ++i) {
    const double z = 9.0 + 4.0 * i;
    frame.vehicles.push_back(test::make_vehicle(
        i, {i % 2 == 0 ? -3.0 : 2.5, test::PictureScene::road_y(z), z}, -1.5 + 0.1 * i));
  }
  Image photo = make_picture(scene.camera.width, scene.camera.height, 110);
  for (std::size_t i = 0; i < photo.data.size(); ++i) {
    photo.data[i] = static_cast<std::uint8_t>(90 + (i * 7919) % 60);
  }
  OverlayOptions plain, full;
  full.show_ellipses = full.show_patches = full.show_normals = full.show_grade = true;
  OverlayOptions large = full;
  large.upscale = 3840.0 / 1242.0;
  const OverlayRoad road{&scene.surface, SE3(), nullptr};
  std::printf(
      "overlay of 1242x375 with 10 vehicles, CPU ms, least of %d (the first: with the "
      "letters' bitmaps)\n",
      30 * repeats);
  bench::Table& table = report.table("overlay", "Overlay of 1242x375 with 10 vehicles", "",
                                     {bench::label("overlay"), bench::timing("CPU")});
  const auto row = [&](const char* printed, const char* name, int times, const auto& job) {
    const double milliseconds = least_cpu_ms(times, job);
    std::printf("  %s %.1f\n", printed, milliseconds);
    table.row({name, milliseconds});
  };
  row("first", "the first of a process", 1,
      [&] { draw_overlay(photo, scene.camera, frame, plain); });
  row("wireframes, boxes, planes, labels", "wireframes, boxes, planes, labels", 30 * repeats,
      [&] { draw_overlay(photo, scene.camera, frame, plain); });
  row("with ellipses and the road       ", "with ellipses and the road", 30 * repeats,
      [&] { draw_overlay(photo, scene.camera, frame, full, road); });
  row("the same on 3840 columns         ", "the same on 3840 columns", repeats,
      [&] { draw_overlay(photo, scene.camera, frame, large, road); });
}

}  // namespace

int main(int argc, char** argv) {
  return bench::run_program(
      {"bench_pictures",
       "Times of pictures: a million points by the program, overlays of one frame",
       {},
       {{"--repeats", "N", "How often each is made (default: 7)"}}},
      argc, argv, [](bench::Report& report) {
        const int repeats =
            report.accuracy_only() ? 1 : static_cast<int>(report.count("--repeats", 7));
        programs(report, repeats);
        overlays(report, repeats);
      });
}
