#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/geometry/box.h"

namespace camber {

enum class DetectionForm {
  kCocoDataset,    ///< JSON with images, annotations and categories
  kCocoResults,    ///< JSON, a bare list with image_id, category_id, bbox, score
  kYolo,           ///< text: class cx cy w h [score], shares of the image; polygons by their bounds
  kAbsoluteText,   ///< text: class score left top width height, pixels
  kVoc,            ///< Pascal VOC XML, a file an image
  kMot,            ///< MOTChallenge: frame, id, left, top, width, height, score, ...
  kVisDrone,       ///< left,top,width,height,score,class,truncation,occlusion, a file an image
  kVisDroneVideo,  ///< the same behind frame and target, a file a sequence
  kKittiObject,    ///< KITTI labels, a file an image
  kKittiTracking,  ///< KITTI labels, a file a sequence
  kBdd,            ///< BDD100K and Scalabel JSON
  kCvatImages,     ///< CVAT XML 1.1 for images
  kCvatVideo,      ///< CVAT XML 1.1 for videos
};

/// "COCO data set", "YOLO", ...
std::string to_string(DetectionForm form);

/// A box as its file has it.
struct DetectedBox {
  std::string class_name;  ///< empty: the file has a number, or nothing
  std::optional<std::int64_t> class_number;
  Box2 box;                                                 ///< pixels, as written
  double score = std::numeric_limits<double>::quiet_NaN();  ///< NaN: none
  std::int64_t track = -1;                                  ///< -1: none
  bool ignored = false;  ///< a region that the file takes out: DontCare, a crowd, a MOT row of 0
};

/// The boxes of one image.
struct DetectedImage {
  std::string file_name;               ///< as written, or of the file itself; empty: by number
  std::optional<std::int64_t> number;  ///< id or frame number of the file
  std::optional<int> width, height;    ///< pixels
  std::vector<DetectedBox> boxes;
};

/// A detection file, or a folder of them.
struct DetectionFile {
  DetectionForm form = DetectionForm::kCocoDataset;
  std::vector<DetectedImage> images;
  std::map<std::int64_t, std::string> classes;  ///< names by number, where the file has them
  std::map<std::string, int> other_shapes;      ///< labels without a box, by their kind
  std::size_t box_count() const;
};

struct DetectionOptions {
  std::filesystem::path class_names;  ///< read_class_names(); empty: as the files have them
  /// Width and height of the image that a file of shares (YOLO) belongs to, by the file's stem.
  std::function<std::optional<std::pair<int, int>>(const std::string& stem)> image_size;
};

/// Reads boxes; content decides the form. Class numbers without names in the file are named by
/// options.class_names, else by a list beside the files (obj.names, classes.txt, data.yaml), else,
/// for COCO results and YOLO, by the data set COCO.
/// @param path  a file, or a folder of files an image (YOLO, VOC, KITTI, text).
/// @throws InputError "file: position: found, expected"; for 3D boxes of KITTI's tracklets, which
///         have no box in an image.
DetectionFile read_detections(const std::filesystem::path& path,
                              const DetectionOptions& options = {});

/// Class names: a name a line (darknet's .names, classes.txt), a data file of darknet that points
/// to such a list, or the names of a YAML file (a list, or by number). From number 0.
std::map<std::int64_t, std::string> read_class_names(const std::filesystem::path& path);

/// The 80 classes of COCO as detectors number them (from 0), and by the data set's category ids.
const std::vector<std::string>& coco_class_names();
std::string coco_category_name(std::int64_t category_id);  ///< empty: there is no such one

/// Keys and values of a small text file: "name=TUD-Campus" (MOT's seqinfo.ini), "classes = 20"
/// (darknet's .data). Sections in brackets are passed over.
std::map<std::string, std::string> read_key_values(const std::filesystem::path& path);

}  // namespace camber
