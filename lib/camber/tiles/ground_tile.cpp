#include "camber/tiles/ground_tile.h"

#include <algorithm>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/tiles/tile_points.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr unsigned kWithheld = 4;  // of class_flags, in all point formats

bool is_judged(const TilePlan& plan, const TilePoints& points, std::size_t i) {
  return (points.flags[i] & kWithheld) == 0 &&
         std::find(plan.keep_classes.begin(), plan.keep_classes.end(), points.classes[i]) ==
             plan.keep_classes.end();
}

/// Leaves the judged points, in their order. @return their numbers in the file, -1 of others
std::vector<std::int32_t> keep_judged(const TilePlan& plan, TilePoints* points) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points->own.size(); ++i) {
    if (!is_judged(plan, *points, i)) continue;
    points->cloud.points[kept] = points->cloud.points[i];
    points->own[kept++] = points->own[i];
  }
  points->cloud.points.resize(kept);
  points->own.resize(kept);
  return std::move(points->own);
}

TileGround segment(const TilePlan& plan, TilePoints points, int num_threads) {
  TileGround out;
  out.read_points = points.read_points;
  out.labels.assign(static_cast<std::size_t>(points.own_points), -1);
  const std::vector<std::int32_t> own = keep_judged(plan, &points);
  points.classes = {};
  points.flags = {};
  throw_if_interrupted();
  GroundOptions options;
  options.plan = plan.ground;
  options.num_threads = num_threads;
  // Where nothing is ground, the status is kFailed and the labels are 0.
  const GroundSegmentation found = segment_ground(points.cloud, options);
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (own[i] < 0) continue;
    out.labels[static_cast<std::size_t>(own[i])] = found.labels[i];
    ++out.judged;
    out.ground += found.labels[i] > 0 ? 1 : 0;
  }
  return out;
}

TileReading reading_of(const TilePlan& plan, int num_threads) {
  if (!plan.ground) {
    throw NoAnswerError(plan.folder.string() + ": the plan has no ground: " + plan.ground_reason);
  }
  TileReading reading;
  reading.halo = plan.ground->reach();
  reading.alignment = plan.ground->alignment();
  reading.classes = true;
  reading.num_threads = num_threads;
  return reading;
}

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

TileGround segment_tile_ground(const TilePlan& plan, std::size_t tile, int num_threads,
                               detail::KeptParts* kept) {
  TileReading reading = reading_of(plan, num_threads);
  reading.kept = kept;
  return segment(plan, read_tile_points(plan, tile, reading), num_threads);
}

TileGround segment_whole_ground(const TilePlan& plan, const fs::path& file, int num_threads) {
  return segment(plan, read_whole_points(plan, file, reading_of(plan, num_threads)), num_threads);
}

void decide_ground(TilePlan* plan, const GroundOptions& given) {
  constexpr std::size_t kMostSamples = 5;
  TileReading reading;
  reading.halo = 100.0;  // m: a cloud of less than 60 m is never taken for one from the air
  reading.classes = true;
  reading.num_threads = given.num_threads;
  std::vector<GroundPlan> found;
  std::string reason = "no tile has points that count";
  for (const std::size_t tile : sample_tiles(*plan, kMostSamples)) {
    TilePoints points = read_tile_points(*plan, tile, reading);
    keep_judged(*plan, &points);
    throw_if_interrupted();
    const GroundSegmentation sample = segment_ground(points.cloud, given);
    if (sample.status == Status::kFailed) {
      reason = sample.reason;
      continue;
    }
    found.push_back(sample.plan());
  }
  plan->ground.reset();
  plan->ground_reason = reason;
  if (found.empty()) return;
  plan->ground_reason.clear();
  const auto from_air = std::count_if(found.begin(), found.end(),
                                      [](const GroundPlan& sample) { return sample.from_air; });
  const bool air = 2 * static_cast<std::size_t>(from_air) > found.size();
  found.erase(std::remove_if(found.begin(), found.end(),
                             [&](const GroundPlan& sample) { return sample.from_air != air; }),
              found.end());
  GroundPlan chosen = found.front();
  for (double GroundPlan::*number :
       {&GroundPlan::cell, &GroundPlan::tolerance, &GroundPlan::foot_tolerance}) {
    std::vector<double> values;
    for (const GroundPlan& sample : found) values.push_back(sample.*number);
    chosen.*number = median_of(values);
  }
  chosen.validate();
  plan->ground = chosen;
}

}  // namespace camber
