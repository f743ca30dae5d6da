#include "camber/import/formats/detections.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/detail/detection_forms.h"
#include "camber/import/formats/detail/document.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/import_common.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Ids of the data set COCO of the 80 classes: 90 numbers with gaps.
constexpr int kCocoIds[] = {1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 13, 14, 15, 16, 17,
                            18, 19, 20, 21, 22, 23, 24, 25, 27, 28, 31, 32, 33, 34, 35, 36,
                            37, 38, 39, 40, 41, 42, 43, 44, 46, 47, 48, 49, 50, 51, 52, 53,
                            54, 55, 56, 57, 58, 59, 60, 61, 62, 63, 64, 65, 67, 70, 72, 73,
                            74, 75, 76, 77, 78, 79, 80, 81, 82, 84, 85, 86, 87, 88, 89, 90};

DetectionFile read_one(const fs::path& path, const DetectionOptions& options) {
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".txt" || extension == ".csv") return detections_of_text(path, options);
  const std::string text = read_whole_file(path);
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string::npos)
    throw InputError(path.string(), "found an empty file, expected boxes");
  if (text[first] == '{' || text[first] == '[') return detections_of_json(text, path);
  if (text[first] == '<') return detections_of_xml(text, path);
  return detections_of_text(path, options);
}

/// Lists that stand beside annotations and hold none.
bool is_companion(const fs::path& file) {
  static const std::set<std::string> names = {"classes.txt", "obj.names",   "labels.txt",
                                              "train.txt",   "val.txt",     "test.txt",
                                              "readme.txt",  "labelmap.txt"};
  return names.count(lower_case(file.filename().string())) > 0;
}

DetectionFile read_folder(const fs::path& folder, const DetectionOptions& options) {
  std::vector<fs::path> files;
  for (const fs::path& file : files_in(folder)) {
    const std::string extension = lower_case(file.extension().string());
    if ((extension == ".txt" || extension == ".xml" || extension == ".json") &&
        !is_companion(file)) {
      files.push_back(file);
    }
  }
  if (files.empty()) {
    throw InputError(folder.string(),
                     "found no .txt, .xml or .json file, expected one of boxes for each image");
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.string(), b.string());
  });
  DetectionFile out;
  fs::path first;
  for (const fs::path& file : files) {
    DetectionFile one = read_one(file, options);
    const bool empty =
        one.images.empty() || (one.images.size() == 1 && one.images[0].boxes.empty());
    if (!empty && first.empty()) {
      first = file;
      out.form = one.form;
    }
    if (!empty && one.form != out.form) {
      throw InputError(file.string(),
                       fmt::format("found boxes as {}, expected {} as in {}", to_string(one.form),
                                   to_string(out.form), printable(first.filename().string())));
    }
    const bool by_number =
        one.form == DetectionForm::kMot || one.form == DetectionForm::kVisDroneVideo ||
        one.form == DetectionForm::kKittiTracking || one.form == DetectionForm::kCvatVideo;
    if (!empty && by_number && files.size() > 1) {
      throw InputError(file.string(),
                       fmt::format("found boxes as {} in a folder of several files, expected "
                                   "the file's own path",
                                   to_string(one.form)));
    }
    out.images.insert(out.images.end(), std::make_move_iterator(one.images.begin()),
                      std::make_move_iterator(one.images.end()));
    for (const auto& [kind, count] : one.other_shapes) out.other_shapes[kind] += count;
    out.classes.merge(one.classes);
  }
  return out;
}

/// A list of classes beside the annotations, or one folder up; empty: none.
fs::path names_beside(const fs::path& path) {
  std::error_code error;
  const fs::path folder = fs::is_directory(path, error) ? path : path.parent_path();
  for (const fs::path& place :
       {folder, fs::absolute(folder, error).lexically_normal().parent_path()}) {
    for (const char* name :
         {"obj.names", "classes.txt", "data.yaml", "dataset.yaml", "coco.names"}) {
      if (fs::is_regular_file(place / name, error)) return place / name;
    }
  }
  return {};
}

void name_classes(const fs::path& path, const DetectionOptions& options, DetectionFile* out) {
  bool unnamed = false;
  for (const DetectedImage& image : out->images) {
    for (const DetectedBox& box : image.boxes)
      unnamed |= box.class_name.empty() && box.class_number;
  }
  fs::path list = options.class_names;
  if (list.empty() && unnamed && out->form != DetectionForm::kCocoResults && out->classes.empty()) {
    list = names_beside(path);
  }
  if (!list.empty()) {
    out->classes = read_class_names(list);
  } else if (out->classes.empty() && out->form == DetectionForm::kYolo) {
    for (std::size_t i = 0; i < coco_class_names().size(); ++i) {
      out->classes[static_cast<std::int64_t>(i)] = coco_class_names()[i];
    }
  }
  const bool by_category =
      out->form == DetectionForm::kCocoResults && list.empty() && out->classes.empty();
  for (DetectedImage& image : out->images) {
    for (DetectedBox& box : image.boxes) {
      if (!box.class_name.empty() || !box.class_number) continue;
      if (const auto at = out->classes.find(*box.class_number); at != out->classes.end()) {
        box.class_name = at->second;
      } else if (by_category) {
        box.class_name = coco_category_name(*box.class_number);
      }
    }
  }
}

}  // namespace

std::string to_string(DetectionForm form) {
  switch (form) {
    case DetectionForm::kCocoDataset:
      return "COCO data set";
    case DetectionForm::kCocoResults:
      return "COCO results";
    case DetectionForm::kYolo:
      return "YOLO";
    case DetectionForm::kAbsoluteText:
      return "text (class score left top width height)";
    case DetectionForm::kVoc:
      return "Pascal VOC";
    case DetectionForm::kMot:
      return "MOT";
    case DetectionForm::kVisDrone:
      return "VisDrone";
    case DetectionForm::kVisDroneVideo:
      return "VisDrone video";
    case DetectionForm::kKittiObject:
      return "KITTI objects";
    case DetectionForm::kKittiTracking:
      return "KITTI tracking";
    case DetectionForm::kBdd:
      return "BDD100K";
    case DetectionForm::kCvatImages:
      return "CVAT for images";
    case DetectionForm::kCvatVideo:
      return "CVAT for videos";
  }
  return "";
}

std::size_t DetectionFile::box_count() const {
  std::size_t out = 0;
  for (const DetectedImage& image : images) out += image.boxes.size();
  return out;
}

DetectionFile read_detections(const fs::path& path, const DetectionOptions& options) {
  std::error_code error;
  DetectionFile out =
      fs::is_directory(path, error) ? read_folder(path, options) : read_one(path, options);
  // Things that stand there, none of them a box: captions, outlines or something else.
  const bool coco =
      out.form == DetectionForm::kCocoDataset || out.form == DetectionForm::kCocoResults;
  if (coco && out.box_count() == 0 && !out.other_shapes.empty()) {
    const auto& [kind, count] = *out.other_shapes.begin();
    throw InputError(path.string(), fmt::format("found no box (of {}: {}), expected boxes",
                                                printable(kind), count));
  }
  name_classes(path, options, &out);
  return out;
}

std::map<std::int64_t, std::string> read_class_names(const fs::path& path) {
  std::map<std::int64_t, std::string> out;
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".yaml" || extension == ".yml" || extension == ".json") {
    const Document document = Document::read(path);
    const auto names = find_by_plain_name(document.root(), {"names", "classes", "labels"});
    if (!names) document.fail(document.root(), "found no names, expected a list of classes");
    std::int64_t next = 0;
    if (names->IsSequence()) {
      for (const YAML::Node& name : *names) out[next++] = text_of(name);
    } else if (names->IsMap()) {
      for (const auto& entry : *names) {
        out[document.integer(entry.first, 0, 1000000, "a class number")] = text_of(entry.second);
      }
    }
    if (out.empty()) document.expected(*names, "a list of class names");
    return out;
  }
  if (extension == ".data") {
    const auto values = read_key_values(path);
    const auto names = values.find("names");
    if (names == values.end())
      throw InputError(path.string(), "found no names = FILE, expected a list of classes");
    // Written for another folder: the list's own name beside this file stands for it.
    const fs::path beside = path.parent_path() / fs::path(names->second).filename();
    std::error_code error;
    return read_class_names(fs::exists(beside, error) ? beside
                                                      : path.parent_path() / names->second);
  }
  const std::string text = read_whole_file(path);
  std::size_t start = 0;
  while (start < text.size()) {
    std::size_t end = text.find('\n', start);
    if (end == std::string::npos) end = text.size();
    std::string name = text.substr(start, end - start);
    start = end + 1;
    name.erase(0, name.find_first_not_of(" \t\r"));
    name.erase(name.find_last_not_of(" \t\r") + 1);
    if (name.find('\0') != std::string::npos)
      throw InputError(path.string(), "found a null byte, expected text");
    if (!name.empty()) out[static_cast<std::int64_t>(out.size())] = name;
  }
  if (out.empty()) throw InputError(path.string(), "found no class name, expected one a line");
  return out;
}

std::map<std::string, std::string> read_key_values(const fs::path& path) {
  const DelimitedLines lines(path, '=');
  std::map<std::string, std::string> out;
  for (const DelimitedLine& line : lines.lines()) {
    if (line.fields[0].empty() || line.fields[0][0] == '[' || line.fields[0][0] == ';') continue;
    if (line.fields.size() < 2) {
      lines.fail(line, fmt::format("found '{}', expected key = value", printable(line.fields[0])));
    }
    out[std::string(line.fields[0])] = std::string(line.fields[1]);
  }
  return out;
}

const std::vector<std::string>& coco_class_names() {
  static const std::vector<std::string> names = {"person",        "bicycle",      "car",
                                                 "motorcycle",    "airplane",     "bus",
                                                 "train",         "truck",        "boat",
                                                 "traffic light", "fire hydrant", "stop sign",
                                                 "parking meter", "bench",        "bird",
                                                 "cat",           "dog",          "horse",
                                                 "sheep",         "cow",          "elephant",
                                                 "bear",          "zebra",        "giraffe",
                                                 "backpack",      "umbrella",     "handbag",
                                                 "tie",           "suitcase",     "frisbee",
                                                 "skis",          "snowboard",    "sports ball",
                                                 "kite",          "baseball bat", "baseball glove",
                                                 "skateboard",    "surfboard",    "tennis racket",
                                                 "bottle",        "wine glass",   "cup",
                                                 "fork",          "knife",        "spoon",
                                                 "bowl",          "banana",       "apple",
                                                 "sandwich",      "orange",       "broccoli",
                                                 "carrot",        "hot dog",      "pizza",
                                                 "donut",         "cake",         "chair",
                                                 "couch",         "potted plant", "bed",
                                                 "dining table",  "toilet",       "tv",
                                                 "laptop",        "mouse",        "remote",
                                                 "keyboard",      "cell phone",   "microwave",
                                                 "oven",          "toaster",      "sink",
                                                 "refrigerator",  "book",         "clock",
                                                 "vase",          "scissors",     "teddy bear",
                                                 "hair drier",    "toothbrush"};
  return names;
}

std::string coco_category_name(std::int64_t category_id) {
  const auto at = std::find(std::begin(kCocoIds), std::end(kCocoIds), category_id);
  return at == std::end(kCocoIds)
             ? ""
             : coco_class_names()[static_cast<std::size_t>(at - std::begin(kCocoIds))];
}

}  // namespace camber
