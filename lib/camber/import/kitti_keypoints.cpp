#include "camber/import/kitti_keypoints.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kMaxId = 2000000000;
constexpr double kLeastOverlap = 0.5;

KittiKeypoints read_set(const JsonCursor& cursor) {
  JsonObject object(cursor, "keypoints of a car {\"frame\", \"keypoints_uv_confidence\", ...}");
  KittiKeypoints out;
  out.frame = object.require("frame", "a frame number").integer(0, kMaxId, "a frame number");
  if (auto v = object.find("sequence")) out.sequence = v->integer(0, 9999, "a sequence's number");
  if (auto v = object.find("track_id")) out.track = v->integer(-1, kMaxId, "a track id");
  if (out.track && *out.track < 0) out.track.reset();
  if (auto v = object.find("bbox_xyxy")) {
    const std::vector<double> box = v->numbers(4, "4 numbers [x1, y1, x2, y2]");
    out.box = Box2{box[0], box[1], box[2], box[3]};
  }
  if (!out.track && !out.box) object.require("track_id", "a track id, or a bbox_xyxy");
  const std::string expectation = fmt::format("{} rows [u, v, confidence]", kNumKeypoints);
  const JsonCursor list = object.require("keypoints_uv_confidence", expectation.c_str());
  const std::vector<JsonCursor> rows = list.items(expectation.c_str());
  if (rows.size() != kNumKeypoints) {
    list.fail_because(fmt::format("found {} rows, expected {}", rows.size(), expectation));
  }
  for (const JsonCursor& row : rows) {
    const std::vector<JsonCursor> numbers = row.items("3 numbers [u, v, confidence]");
    if (numbers.size() != 3) row.fail("3 numbers [u, v, confidence]");
    out.keypoints.push_back(
        {{numbers[0].number(), numbers[1].number()}, numbers[2].number_or_null()});
  }
  return out;
}

VehicleDetection* detection_of(const KittiKeypoints& set, SceneFrame* frame) {
  VehicleDetection* best = nullptr;
  double largest = kLeastOverlap;
  for (VehicleDetection& detection : frame->vehicles) {
    if (set.track && detection.track >= 0) {
      if (detection.track == *set.track) return &detection;
      continue;
    }
    if (!set.box) continue;
    const double overlap = intersection_over_union(*set.box, detection.box);
    if (overlap < largest) continue;
    largest = overlap;
    best = &detection;
  }
  return best;
}

}  // namespace

std::vector<KittiKeypoints> read_kitti_keypoints(const fs::path& path) {
  const nlohmann::json document = parse_json(read_whole_file(path), path.string());
  JsonContext context;
  context.file = path.string();
  std::vector<KittiKeypoints> out;
  for (const JsonCursor& set :
       JsonCursor(document, context).items("a list of keypoints, one object a car and frame")) {
    out.push_back(read_set(set));
  }
  return out;
}

KeypointMatches put_kitti_keypoints(const std::vector<KittiKeypoints>& sets,
                                    const std::optional<int>& sequence, const fs::path& file,
                                    Scene* scene) {
  KeypointMatches out;
  for (const KittiKeypoints& set : sets) {
    if (set.sequence && !sequence) {
      throw InputError(file.string(),
                       fmt::format("found keypoints of sequence {}, expected to know the images' "
                                   "own (a folder like image_02/0009, or --sequence)",
                                   *set.sequence));
    }
    if (set.sequence && *set.sequence != *sequence) continue;
    for (SceneFrame& frame : scene->frames) {
      if (frame.id != set.frame) continue;
      VehicleDetection* detection = detection_of(set, &frame);
      ++(detection ? out.placed : out.left_over);
      if (detection) detection->keypoints = set.keypoints;
    }
  }
  return out;
}

}  // namespace camber
