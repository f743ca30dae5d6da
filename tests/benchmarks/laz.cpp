// How fast LAZ is decoded and written: a made tile of ten million points in formats 3 and 7, one
// thread and two. With $CAMBER_NODE_MODULES (the folder in which `npm install laz-perf` put that
// package) laz-perf decodes the same files in the same run, and the ratio is printed.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "benchmarks/cpu_time.h"
#include "benchmarks/report.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/random.h"
#include "support/test_data.h"

namespace camber::benchmarks {
namespace {

namespace fs = std::filesystem;

template <typename T>
void put(std::string& out, std::size_t at, T value) {
  std::memcpy(out.data() + at, &value, sizeof value);
}

/// LAS (ASPRS, "LAS Specification 1.4 - R15") of a hilly kilometre square, flown in eight strips:
/// 2 cm of noise, steps of 1 mm, one or two returns, colours that change slowly.
/// @param format  3 or 7
std::string make_las(std::size_t points, int format, std::uint64_t seed) {
  const std::size_t header = format == 3 ? 227 : 375, record = format == 3 ? 34 : 36;
  std::string out(header + points * record, '\0');
  std::memcpy(out.data(), "LASF", 4);
  put<std::uint8_t>(out, 24, 1);
  put<std::uint8_t>(out, 25, format == 3 ? 2 : 4);
  put<std::uint16_t>(out, 94, static_cast<std::uint16_t>(header));
  put<std::uint32_t>(out, 96, static_cast<std::uint32_t>(header));
  put<std::uint8_t>(out, 104, static_cast<std::uint8_t>(format));
  put<std::uint16_t>(out, 105, static_cast<std::uint16_t>(record));
  if (format == 3) put<std::uint32_t>(out, 107, static_cast<std::uint32_t>(points));
  for (std::size_t axis = 0; axis < 3; ++axis) put(out, 131 + 8 * axis, 0.001);
  if (format == 7) put<std::uint64_t>(out, 247, points);
  const CounterRandom random(seed);
  constexpr double kSide = 1000.0;  // m
  constexpr std::size_t kStrips = 8;
  constexpr double kLine = 80.0;  // points across a strip
  const double width = kSide / kStrips;
  const std::size_t per_strip = (points + kStrips - 1) / kStrips;
  for (std::size_t i = 0; i < points; ++i) {
    const auto draw = [&](std::uint64_t k) { return random.uniform(8 * i + k, 0.0, 1.0); };
    const std::size_t strip = i / per_strip;
    const double along = static_cast<double>(i % per_strip) / static_cast<double>(per_strip);
    const double swing = std::fmod(static_cast<double>(i), 2.0 * kLine) / kLine;
    const double x = width * (static_cast<double>(strip) + (swing < 1.0 ? swing : 2.0 - swing)) +
                     0.1 * (draw(0) - 0.5);
    const double y = kSide * (strip % 2 == 0 ? along : 1.0 - along) + 0.1 * (draw(1) - 0.5);
    // Ground; a fifth of all are returns of what stands on it.
    const bool above = draw(2) < 0.2;
    const double z = 200.0 + 15.0 * std::sin(x / 90.0) + 9.0 * std::cos(y / 70.0) +
                     0.02 * std::sqrt(12.0) * (draw(3) - 0.5) + (above ? 12.0 * draw(4) : 0.0);
    const std::size_t at = header + i * record;
    put(out, at, static_cast<std::int32_t>(std::lround(1000.0 * x)));
    put(out, at + 4, static_cast<std::int32_t>(std::lround(1000.0 * y)));
    put(out, at + 8, static_cast<std::int32_t>(std::lround(1000.0 * z)));
    put(out, at + 12, static_cast<std::uint16_t>(400.0 + 200.0 * draw(5)));
    const unsigned returns = above ? 2 : 1;
    const auto number = static_cast<unsigned>(1 + (above && draw(6) < 0.5 ? 1 : 0));
    const double time = 1e5 + 60.0 * static_cast<double>(strip) + 1e-5 * static_cast<double>(i);
    const auto shade =
        static_cast<std::uint16_t>(256.0 * (100.0 + 60.0 * std::sin(x / 11.0) + 8.0 * draw(7)));
    const std::array<std::uint16_t, 3> colour{shade, static_cast<std::uint16_t>(shade / 2 + 9000),
                                              static_cast<std::uint16_t>(shade / 3 + 7000)};
    const auto kind = static_cast<std::uint8_t>(above ? 5 : 2);
    const auto source = static_cast<std::uint16_t>(strip + 1);
    const double angle = 20.0 * (swing < 1.0 ? swing - 0.5 : 1.5 - swing);
    if (format == 3) {
      put(out, at + 14, static_cast<std::uint8_t>(number | returns << 3));
      put(out, at + 15, kind);
      put(out, at + 16, static_cast<std::int8_t>(angle));
      put(out, at + 18, source);
      put(out, at + 20, time);
      put(out, at + 28, colour);
    } else {
      put(out, at + 14, static_cast<std::uint8_t>(number | returns << 4));
      put(out, at + 16, kind);
      put(out, at + 18, static_cast<std::int16_t>(angle / 0.006));
      put(out, at + 20, source);
      put(out, at + 22, time);
      put(out, at + 30, colour);
    }
  }
  return out;
}

std::string write_laz(const std::string& las) {
  const auto source = open_point_source(las.data(), las.size(), "made.las");
  std::ostringstream out;
  const auto sink =
      make_point_sink(out, source->header(), CloudFormat::kLaz, CloudEncoding::kBinary);
  for (PointBatch batch; source->next(batch);) sink->write(batch);
  sink->finish();
  return out.str();
}

struct Seconds {
  double cpu = std::numeric_limits<double>::infinity(), wall = cpu;
};

template <typename Work>
Seconds measure(const Work& work) {
  const double before = bench::cpu_ms();
  const auto begin = std::chrono::steady_clock::now();
  work();
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin;
  return {1e-3 * (bench::cpu_ms() - before), wall.count()};
}

Seconds least(const Seconds& a, const Seconds& b) {
  return {std::min(a.cpu, b.cpu), std::min(a.wall, b.wall)};
}

void decode(const std::string& laz, std::size_t points, int threads, bool places_alone) {
  ReadOptions options;
  options.num_threads = threads;
  if (places_alone) options.attributes = std::vector<std::string>();
  const auto source = open_point_source(laz.data(), laz.size(), "made.laz", options);
  std::size_t found = 0;
  for (PointBatch batch; source->next(batch);) found += batch.count;
  if (found != points) std::abort();
}

/// Seconds of one core that laz-perf takes; NaN: it is not there.
double laz_perf_seconds(const std::string& laz) {
  const char* const modules = std::getenv("CAMBER_NODE_MODULES");
  if (modules == nullptr) return std::nan("");
  const test::TemporaryFolder folder;
  const fs::path file = folder.path() / "made.laz", out = folder.path() / "seconds";
  std::ofstream(file, std::ios::binary) << laz;
  const std::string command = "NODE_PATH='" + std::string(modules) + "' node '" +
                              (fs::path(CAMBER_SOURCE_DIR) / "tests/cloud/laz_perf.js").string() +
                              "' '" + file.string() + "' > '" + out.string() + "'";
  if (std::system(command.c_str()) != 0) return std::nan("");
  double seconds = std::nan("");
  std::ifstream(out) >> seconds;
  return seconds;
}

void laz(bench::Report& report) {
  const std::size_t points = report.count("--points", 10000000),
                    turns = report.accuracy_only() ? 1 : report.count("--turns", 3);
  bench::Table& table = report.table(
      "laz.decoding", "LAZ by format", "laz",
      {bench::label("file"), bench::value("bytes a point"), bench::timing("one thread, CPU", "s"),
       bench::timing("a core", "1e6 points/s"), bench::timing("two threads, CPU", "s"),
       bench::timing("wall, one to two"), bench::timing("laz-perf, CPU to ours")});
  for (const int format : {3, 7}) {
    const std::string las = make_las(points, format, report.seed());
    std::string made;
    Seconds writing;
    for (std::size_t turn = 0; turn < turns; ++turn) {
      writing = least(writing, measure([&] { made = write_laz(las); }));
    }
    const double bytes = static_cast<double>(made.size()) / static_cast<double>(points);
    const auto print = [&](const char* what, Seconds one, Seconds two, double peer) {
      const std::string name = "format " + std::to_string(format) + what;
      const double rate = 1e-6 * static_cast<double>(points) / one.cpu;
      const double gain = std::isfinite(two.wall) ? one.wall / two.wall : std::nan("");
      table.row({name, bytes, one.cpu, rate, two.cpu, gain, peer / one.cpu});
      std::printf("%-26s %5.2f bytes a point; one thread %5.2f s of CPU, %4.2f million a second",
                  name.c_str(), bytes, one.cpu, rate);
      if (std::isfinite(two.cpu)) {
        std::printf("; two %5.2f s, %4.2f times as fast", two.cpu, gain);
      }
      if (std::isfinite(peer)) std::printf("; laz-perf %5.2f s, %4.2f times", peer, peer / one.cpu);
      std::printf("\n");
      std::fflush(stdout);
    };
    for (const bool places_alone : {false, true}) {
      if (places_alone && format < 6) continue;  // its points are one layer
      Seconds one, two;
      double peer = std::numeric_limits<double>::infinity();
      for (std::size_t turn = 0; turn < turns; ++turn) {
        one = least(one, measure([&] { decode(made, points, 1, places_alone); }));
        two = least(two, measure([&] { decode(made, points, 2, places_alone); }));
        if (!places_alone) peer = std::min(peer, laz_perf_seconds(made));
      }
      print(places_alone ? ", x y z alone" : "", one, two,
            std::isfinite(peer) ? peer : std::nan(""));
    }
    print(", written", writing, {}, std::nan(""));
  }
}

}  // namespace
}  // namespace camber::benchmarks

int main(int argc, char** argv) {
  const camber::bench::Program program{
      "bench_laz",
      "Decoding and writing of LAZ, beside laz-perf where CAMBER_NODE_MODULES names it.",
      {"laz"},
      {{"--points", "N", "points of the made tile; 1e7 if not given", true},
       {"--turns", "N", "the least of so many times is printed; 3 if not given", false}}};
  return camber::bench::run_program(program, argc, argv, camber::benchmarks::laz);
}
