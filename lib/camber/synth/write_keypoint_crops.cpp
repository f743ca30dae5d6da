#include <algorithm>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/version.h"
#include "camber/scene/results.h"
#include "camber/synth/detail/npy_file.h"
#include "camber/synth/keypoint_crops.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

nlohmann::json options_of(const KeypointCropOptions& options) {
  return {{"seed", options.seed},   {"split", to_string(options.split)},
          {"first", options.first}, {"count", options.count},
          {"size", options.size},   {"end_on", options.end_on}};
}

/// The arrays of a set, each crop a row of each.
class CropFiles {
 public:
  /// @param name  of the folder in messages
  CropFiles(const fs::path& folder, const fs::path& name, std::int64_t count, int size) {
    const auto open = [&](const char* file, const char* type, std::vector<std::int64_t> shape) {
      shape.insert(shape.begin(), count);
      return NpyFile(folder / file, (name / file).string(), type, shape);
    };
    files_.push_back(open("images.npy", "|u1", {size, size, 3}));
    files_.push_back(open("keypoints.npy", "<f4", {kNumKeypoints, 2}));
    files_.push_back(open("visibility.npy", "|u1", {kNumKeypoints}));
    files_.push_back(open("boxes.npy", "<f4", {4}));
    files_.push_back(open("true_boxes.npy", "<f4", {4}));
    files_.push_back(open("heading.npy", "<f4", {3}));
    files_.push_back(open("car.npy", "<i4", {}));
  }

  void write(const SynthCrop& crop) {
    files_[kImages].write(crop.image.data.data(), crop.image.data.size());
    std::vector<float> points;
    for (const Eigen::Vector2d& p : crop.keypoints) {
      points.push_back(static_cast<float>(p.x()));
      points.push_back(static_cast<float>(p.y()));
    }
    write(points, &files_[kKeypoints]);
    files_[kVisibility].write(crop.visibility.data(), crop.visibility.size());
    write_box(crop.box, &files_[kBoxes]);
    write_box(crop.true_box, &files_[kTrueBoxes]);
    write({static_cast<float>(crop.azimuth), static_cast<float>(crop.elevation),
           static_cast<float>(crop.distance)},
          &files_[kHeading]);
    const std::int32_t car = crop.car;
    files_[kCar].write(&car, sizeof(car));
  }

  void close() {
    for (NpyFile& file : files_) file.close();
  }

 private:
  static void write(const std::vector<float>& values, NpyFile* file) {
    file->write(values.data(), values.size() * sizeof(float));
  }
  static void write_box(const Box2& box, NpyFile* file) {
    write({static_cast<float>(box.x1), static_cast<float>(box.y1), static_cast<float>(box.x2),
           static_cast<float>(box.y2)},
          file);
  }

  enum { kImages, kKeypoints, kVisibility, kBoxes, kTrueBoxes, kHeading, kCar };
  std::vector<NpyFile> files_;
};

nlohmann::json describe(const KeypointCropOptions& options, const KeypointCropSummary& summary) {
  return {
      {"format", "camber keypoint crops 1"},
      {"version", kVersion},
      {"options", options_of(options)},
      {"crops", summary.crops},
      {"cars", summary.cars},
      {"crop_rule",
       "square, centred on the box, side 1.15 times its larger side; pixel centres at whole "
       "numbers; beyond the image grey 114"},
      {"keypoints_by_visibility",
       {{"visible", summary.keypoints[0]},
        {"hidden_by_car", summary.keypoints[1]},
        {"hidden_by_other", summary.keypoints[2]},
        {"outside", summary.keypoints[3]}}},
      {"files",
       {{"images.npy", "uint8, crops x size x size x 3, red green blue"},
        {"keypoints.npy", "float32, crops x 36 x 2: u, v, px of the crop, also outside"},
        {"visibility.npy",
         "uint8, crops x 36: 0 visible, 1 hidden by the car itself, 2 hidden by something else, "
         "3 outside the image or the crop"},
        {"boxes.npy", "float32, crops x 4: left, top, right, bottom as detected, px of the crop"},
        {"true_boxes.npy", "float32, crops x 4: the whole car's, px of the crop"},
        {"heading.npy",
         "float32, crops x 3: azimuth (rad; 0 from the right, pi/2 from behind), elevation (rad) "
         "and distance (m) of the camera, seen from the car"},
        {"car.npy", "int32, crops: number of the car, even in training, odd in validation"}}}};
}

}  // namespace

KeypointCropSummary write_keypoint_crops(const KeypointCropOptions& options, const fs::path& folder,
                                         bool overwrite, const std::string& command,
                                         const Progress& progress) {
  constexpr std::int64_t kBlock = 512;  // crops in memory
  options.validate();
  KeypointCropSummary summary;
  AtomicFolder atomic(folder, overwrite);
  const fs::path& root = atomic.staging();
  {
    const StageTimer timer(summary.timings, "crops");
    const KeypointCropMaker maker(options);
    CropFiles files(root, folder, options.count, options.size);
    std::int64_t last_car = -1;
    for (std::int64_t done = 0; done < options.count; done += kBlock) {
      if (progress) progress("crops", static_cast<double>(done) / options.count);
      const std::int64_t count = std::min(kBlock, options.count - done);
      for (const SynthCrop& crop : maker.make(options.first + done, count)) {
        files.write(crop);
        ++summary.crops;
        summary.cars += crop.car != last_car;
        last_car = crop.car;
        for (const KeypointVisibility v : crop.visibility) {
          ++summary.keypoints[static_cast<std::size_t>(v)];
        }
      }
    }
    files.close();
  }
  write_json(describe(options, summary), root / "crops.json");
  nlohmann::json timings = nlohmann::json::object();
  for (const auto& [stage, ms] : summary.timings.stages()) timings[stage] = ms;
  write_json({{"version", kVersion},
              {"command", command},
              {"options", options_of(options)},
              {"timings_ms", timings}},
             root / "run.json");
  atomic.commit();
  if (progress) progress("crops", 1.0);
  return summary;
}

}  // namespace camber
