// Boxes of other programs, given to the frames that they belong to.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/image/video.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/formats/detections.h"
#include "camber/import/import_common.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// The frames by the names and numbers that detection files use for them.
class FrameIndex {
 public:
  explicit FrameIndex(const Scene& scene) {
    for (std::size_t i = 0; i < scene.frames.size(); ++i) {
      const fs::path& image = scene.frames[i].image;
      ids_[scene.frames[i].id] = i;
      if (video_frame_name(image)) {
        of_video_ = true;
        continue;
      }
      names_[image.filename().string()] = i;
      stems_[image.stem().string()] = i;
      if (const auto number = trailing_number(image.stem().string())) numbers_.emplace(*number, i);
    }
    unique_numbers_ = numbers_.size() == scene.frames.size();
  }

  std::optional<std::size_t> by_name(const std::string& text) const {
    const fs::path name = fs::path(text).filename();
    if (const auto at = names_.find(name.string()); at != names_.end()) return at->second;
    if (const auto at = stems_.find(name.string()); at != stems_.end()) return at->second;
    if (const auto at = stems_.find(name.stem().string()); at != stems_.end()) return at->second;
    // Roboflow writes "name_jpg.rf.HASH.jpg".
    const std::size_t mark = text.find(".rf.");
    if (mark == std::string::npos) return std::nullopt;
    std::string stem = fs::path(text.substr(0, mark)).filename().string();
    const std::size_t end = stem.rfind('_');
    if (end != std::string::npos) stem.resize(end);
    const auto at = stems_.find(stem);
    return at == stems_.end() ? std::nullopt : std::optional<std::size_t>(at->second);
  }

  bool of_video() const { return of_video_; }

  /// A frame of a video by the last number in the name of a file that somebody wrote it to.
  std::optional<std::size_t> by_video_name(const std::string& name, std::int64_t first) const {
    const auto number = trailing_number(fs::path(name).stem().string());
    const auto at = number ? ids_.find(*number - first) : ids_.end();
    return at == ids_.end() ? std::nullopt : std::optional<std::size_t>(at->second);
  }

  /// What the names of a video's frames count from: 1 where they go from there to the number after
  /// the last frame's, as programs that write frames to files count.
  std::int64_t first_video_number(const std::vector<DetectedImage>& images) const {
    std::optional<std::int64_t> least, greatest;
    for (const DetectedImage& image : images) {
      const auto number = trailing_number(fs::path(image.file_name).stem().string());
      if (!number) continue;
      least = std::min(least.value_or(*number), *number);
      greatest = std::max(greatest.value_or(*number), *number);
    }
    return least == 1 && greatest == ids_.rbegin()->first + 1 ? 1 : 0;
  }

  std::optional<std::size_t> by_id(std::int64_t id) const {
    const auto at = ids_.find(id);
    return at == ids_.end() ? std::nullopt : std::optional<std::size_t>(at->second);
  }

  /// By the last number in the file name, where all frames have different ones; else by id.
  std::optional<std::size_t> by_number(std::int64_t number) const {
    if (unique_numbers_) {
      const auto at = numbers_.find(number);
      return at == numbers_.end() ? std::nullopt : std::optional<std::size_t>(at->second);
    }
    return by_id(number);
  }

 private:
  static std::optional<std::int64_t> trailing_number(const std::string& stem) {
    std::size_t end = stem.size();
    while (end > 0 && (stem[end - 1] < '0' || stem[end - 1] > '9')) --end;
    std::size_t start = end;
    while (start > 0 && stem[start - 1] >= '0' && stem[start - 1] <= '9') --start;
    if (start == end || end - start > 15) return std::nullopt;
    return std::stoll(stem.substr(start, end - start));
  }

  std::map<std::string, std::size_t> names_, stems_;
  std::map<std::int64_t, std::size_t> numbers_, ids_;
  bool unique_numbers_ = false, of_video_ = false;
};

/// The class of Camber's priors for a name of other programs: "vehicle.car" and "Car" are cars.
std::string vehicle_class_of(const std::string& name) {
  std::string lower = lower_case(name);
  static const std::map<std::string, std::string> others = {{"vehicle.car", "car"},
                                                            {"vehicle.truck", "truck"},
                                                            {"vehicle.bus.rigid", "bus"},
                                                            {"vehicle.bus.bendy", "bus"},
                                                            {"automobile", "car"},
                                                            {"suv", "car"},
                                                            {"sedan", "car"},
                                                            {"lorry", "truck"},
                                                            {"minivan", "van"},
                                                            {"vehicle.van", "van"},
                                                            {"pickup", "truck"},
                                                            {"pickup truck", "truck"},
                                                            {"vehicle", "car"},
                                                            {"object--vehicle--car", "car"},
                                                            {"object--vehicle--truck", "truck"},
                                                            {"object--vehicle--bus", "bus"}};
  const auto at = others.find(lower);
  return at == others.end() ? lower : at->second;
}

constexpr double kNoScore = -1.0;  // as MOT and other programs write it

/// What became of the boxes, for one phrase.
struct Tally {
  std::size_t taken = 0, ignored = 0, other_class = 0, unscored = 0, outside = 0, clipped = 0,
              no_frame = 0;
  std::set<std::string> other_names;
  bool by_number_without_class = false;
};

/// A box clipped to the image; nothing if none of it lies inside.
std::optional<Box2> clipped(const Box2& box, const PinholeCamera& camera, bool* changed) {
  const double right = camera.width, bottom = camera.height;
  const Box2 out{std::clamp(box.x1, 0.0, right), std::clamp(box.y1, 0.0, bottom),
                 std::clamp(box.x2, 0.0, right), std::clamp(box.y2, 0.0, bottom)};
  if (!(out.x2 - out.x1 >= 1.0 && out.y2 - out.y1 >= 1.0)) return std::nullopt;
  // A border of a pixel is a matter of how edges are counted.
  *changed = box.x1 < -1.0 || box.y1 < -1.0 || box.x2 > right + 1.0 || box.y2 > bottom + 1.0;
  return out;
}

void put_boxes(const DetectedImage& image, const OwnDetections& options,
               const PinholeCamera& camera, const std::set<std::string>& classes, SceneFrame& frame,
               Tally& tally) {
  int next = 0;
  std::set<int> ids;
  for (const VehicleDetection& v : frame.vehicles) next = std::max(next, v.id + 1);
  for (const DetectedBox& box : image.boxes) {
    std::string name = vehicle_class_of(box.class_name);
    if (name.empty() && (!box.class_number || *box.class_number < 0)) {
      name = options.default_class;
      tally.by_number_without_class = true;
    }
    if (box.ignored) {
      ++tally.ignored;
      continue;
    }
    if (!classes.count(name)) {
      ++tally.other_class;
      if (tally.other_names.size() < 5) {
        tally.other_names.insert(!name.empty()      ? name
                                 : box.class_number ? std::to_string(*box.class_number)
                                                    : "no class");
      }
      continue;
    }
    const bool scored = !std::isnan(box.score) && box.score != kNoScore;
    if (scored && options.least_score > 0.0 && box.score < options.least_score) {
      ++tally.unscored;
      continue;
    }
    bool changed = false;
    const auto inside = clipped(box.box, camera, &changed);
    if (!inside) {
      ++tally.outside;
      continue;
    }
    tally.clipped += changed ? 1 : 0;
    VehicleDetection out;
    out.id = next++;
    out.vehicle_class = name;
    out.box = *inside;
    if (scored) out.score = box.score;
    if (box.track >= 0 && box.track <= 2000000000) out.track = static_cast<int>(box.track);
    frame.vehicles.push_back(std::move(out));
    ++tally.taken;
  }
}

/// Whether a boxes' image may be meant by the frame of its name: "a/0.png" is "x/a/0.png", not
/// "x/b/0.png".
bool ends_with(const fs::path& image, const std::string& name) {
  const fs::path whole = fs::absolute(image).lexically_normal();
  const fs::path part = fs::path(name).lexically_normal();
  auto a = whole.end();
  auto b = part.end();
  while (b != part.begin()) {
    if (a == whole.begin() || *--a != *--b) return false;
  }
  return true;
}

/// The frame of each of the boxes' images, if any. Of images of one name, as of several cameras,
/// the frame's is the one whose path is the end of the frame's own.
/// @throws InputError where that leaves several for a frame.
std::vector<std::optional<std::size_t>> frames_of(
    const DetectionFile& file, const Scene& scene, const fs::path& path,
    const std::function<std::optional<std::size_t>(const DetectedImage&)>& frame_of_image) {
  std::vector<std::optional<std::size_t>> out;
  std::map<std::size_t, std::set<std::string>> names;  // by frame
  for (const DetectedImage& image : file.images) {
    out.push_back(frame_of_image(image));
    if (out.back() && !image.file_name.empty()) names[*out.back()].insert(image.file_name);
  }
  for (auto& [frame, of_frame] : names) {
    if (of_frame.size() < 2) continue;
    const fs::path& image = scene.frames[frame].image;
    std::vector<std::string> own;
    std::copy_if(of_frame.begin(), of_frame.end(), std::back_inserter(own),
                 [&image = image](const std::string& name) { return ends_with(image, name); });
    if (own.size() != 1) {
      throw InputError(
          path.string(),
          fmt::format("found boxes of both {} and {} for the image {}, expected those of one",
                      printable(*of_frame.begin()), printable(*std::next(of_frame.begin())),
                      printable(image.filename().string())));
    }
    of_frame = {own.front()};
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const std::string& name = file.images[i].file_name;
    if (out[i] && !name.empty() && !names[*out[i]].count(name)) out[i].reset();
  }
  return out;
}

/// MOT counts frames from 1, the others from 0 or by the file's number.
/// @param ids_of_recording    see OwnImport
/// @param first_video_number  what the names of a video's frames count from
std::optional<std::size_t> frame_of(const DetectedImage& image, DetectionForm form,
                                    const FrameIndex& index, std::size_t frames,
                                    bool ids_of_recording, std::int64_t first_video_number) {
  if (!image.file_name.empty()) {
    if (index.of_video()) return index.by_video_name(image.file_name, first_video_number);
    if (const auto at = index.by_name(image.file_name)) return at;
  }
  if (!image.number) return std::nullopt;
  const bool from_one = form == DetectionForm::kMot || form == DetectionForm::kVisDroneVideo;
  const bool by_place = from_one || form == DetectionForm::kCvatVideo;
  if (by_place) {
    const std::int64_t at = *image.number - (from_one ? 1 : 0);
    if (ids_of_recording) return index.by_id(at);
    if (at < 0 || at >= static_cast<std::int64_t>(frames)) return std::nullopt;
    return static_cast<std::size_t>(at);
  }
  if (!image.file_name.empty() && form != DetectionForm::kBdd) return std::nullopt;
  return index.by_number(*image.number);
}

}  // namespace

void put_own_detections(Scene& scene, const OwnDetections& options, OwnImport& out) {
  const FrameIndex index(scene);
  DetectionOptions reading;
  reading.class_names = options.class_names;
  const std::pair<int, int> size = {scene.camera.width, scene.camera.height};
  reading.image_size = [&](const std::string&) { return std::make_optional(size); };
  const DetectionFile file = read_detections(options.file, reading);
  std::set<std::string> classes;
  for (const std::string& name : options.classes) classes.insert(lower_case(name));
  Tally tally;
  const std::int64_t counted_from = index.of_video() ? index.first_video_number(file.images) : 0;
  std::size_t images = 0;
  bool by_video_names = false;
  const auto frames = frames_of(file, scene, options.file, [&](const DetectedImage& image) {
    return frame_of(image, file.form, index, scene.frames.size(), out.ids_of_recording,
                    counted_from);
  });
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const DetectedImage& image = file.images[i];
    const auto& at = frames[i];
    if (!at) {
      tally.no_frame += 1;
      continue;
    }
    ++images;
    by_video_names = by_video_names || (index.of_video() && !image.file_name.empty());
    if (image.width && image.height &&
        (*image.width != scene.camera.width || *image.height != scene.camera.height)) {
      throw InputError(
          options.file.string(),
          fmt::format(
              "found boxes of an image of {} x {} pixels for {}, expected the images' {} x {}",
              *image.width, *image.height, printable(image.file_name), scene.camera.width,
              scene.camera.height));
    }
    put_boxes(image, options, scene.camera, classes, scene.frames[*at], tally);
  }
  if (images == 0 && file.box_count() > 0) {
    const DetectedImage& first = file.images.front();
    throw InputError(
        options.file.string(),
        fmt::format("found boxes of {} images (the first is {}), none of which is among the frames",
                    file.images.size(),
                    first.file_name.empty() ? std::to_string(first.number.value_or(0))
                                            : printable(first.file_name)));
  }
  if (tally.taken == 0 && tally.outside > 0) {
    throw InputError(
        options.file.string(),
        fmt::format(
            "found {} boxes wholly outside the images of {} x {} pixels or of no extent, expected "
            "boxes in them",
            tally.outside, scene.camera.width, scene.camera.height));
  }
  scene.detections_source = options.source;
  std::string phrase =
      fmt::format("{} boxes from {} ({})", tally.taken,
                  printable(options.file.filename().string(), 64), to_string(file.form));
  const auto add = [&](std::size_t count, const std::string& what) {
    if (count > 0) phrase += fmt::format(", {} {}", count, what);
  };
  std::string names;
  for (const std::string& name : tally.other_names)
    names += (names.empty() ? "" : ", ") + printable(name);
  add(tally.other_class, "of other classes left out" + (names.empty() ? "" : " (" + names + ")"));
  add(tally.ignored, "that the file marks to be ignored (crowds, DontCare) left out");
  add(tally.unscored, "below the least score left out");
  add(tally.outside, "outside the image left out");
  add(tally.clipped, "clipped to the image");
  add(tally.no_frame, "images of the file are not among the frames");
  for (const auto& [kind, count] : file.other_shapes)
    add(static_cast<std::size_t>(count), printable(kind));
  if (by_video_names) {
    phrase += fmt::format(", their frames by the numbers in the names of images, from {} on",
                          counted_from);
  }
  if (tally.by_number_without_class)
    phrase += ", without classes: all taken as " + options.default_class;
  out.found.push_back(phrase);
}

}  // namespace camber
