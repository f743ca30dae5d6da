#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/detection_forms.h"
#include "camber/import/formats/detail/xml_file.h"

namespace camber {
namespace {

constexpr double kMaxPixel = 1e7;
constexpr double kMaxId = 9e15;  // whole numbers are exact in a double

std::int64_t id_of(const XmlFile& file, const pugi::xml_node& at) {
  const double id = file.attribute_number(at, "id");
  if (id != std::floor(id) || !(std::abs(id) <= kMaxId))
    file.fail(at, fmt::format("found id {}, expected a whole number", id));
  return static_cast<std::int64_t>(id);
}

std::optional<int> side_of(const XmlFile& file, const pugi::xml_node& at, double value) {
  if (value == 0.0) return std::nullopt;  // not known
  if (!(value >= 1.0 && value <= 65535.0) || value != std::floor(value)) {
    file.fail(at, fmt::format("found an image side of {}, expected from 1 to 65535 pixels", value));
  }
  return static_cast<int>(value);
}

void check_box(const XmlFile& file, const pugi::xml_node& at, const Box2& box) {
  for (const double v : {box.x1, box.y1, box.x2, box.y2}) {
    if (!(std::abs(v) <= kMaxPixel))
      file.fail(at, fmt::format("found {} pixels, expected at most 1e7", v));
  }
  if (box.x1 > box.x2 || box.y1 > box.y2) {
    file.fail(at, fmt::format(
                      "found a box from {}, {} to {}, {}, expected left <= right and top <= bottom",
                      box.x1, box.y1, box.x2, box.y2));
  }
}

DetectionFile voc(const XmlFile& file) {
  const pugi::xml_node root = file.root();
  DetectionFile out;
  out.form = DetectionForm::kVoc;
  DetectedImage image;
  image.file_name = root.child_value("filename");
  if (const pugi::xml_node size = root.child("size")) {
    image.width = side_of(file, size, file.child_number(size, "width"));
    image.height = side_of(file, size, file.child_number(size, "height"));
  }
  for (const pugi::xml_node& object : root.children("object")) {
    const pugi::xml_node bounds = object.child("bndbox");
    if (!bounds) {
      ++out.other_shapes["object without a box"];
      continue;
    }
    DetectedBox box;
    box.class_name = object.child_value("name");
    if (box.class_name.empty())
      file.fail(object, "found an object without a name, expected its class");
    box.box = {file.child_number(bounds, "xmin"), file.child_number(bounds, "ymin"),
               file.child_number(bounds, "xmax"), file.child_number(bounds, "ymax")};
    check_box(file, bounds, box.box);
    image.boxes.push_back(std::move(box));
  }
  out.images.push_back(std::move(image));
  return out;
}

Box2 cvat_box(const XmlFile& file, const pugi::xml_node& at) {
  const Box2 out{file.attribute_number(at, "xtl"), file.attribute_number(at, "ytl"),
                 file.attribute_number(at, "xbr"), file.attribute_number(at, "ybr")};
  check_box(file, at, out);
  return out;
}

DetectionFile cvat_images(const XmlFile& file) {
  DetectionFile out;
  out.form = DetectionForm::kCvatImages;
  for (const pugi::xml_node& element : file.root().children("image")) {
    DetectedImage image;
    image.file_name = element.attribute("name").value();
    if (element.attribute("id")) image.number = id_of(file, element);
    if (element.attribute("width"))
      image.width = side_of(file, element, file.attribute_number(element, "width"));
    if (element.attribute("height"))
      image.height = side_of(file, element, file.attribute_number(element, "height"));
    for (const pugi::xml_node& shape : element.children()) {
      if (shape.type() != pugi::node_element) continue;
      if (std::string(shape.name()) != "box") {
        ++out.other_shapes[shape.name()];
        continue;
      }
      DetectedBox box;
      box.class_name = shape.attribute("label").value();
      box.box = cvat_box(file, shape);
      image.boxes.push_back(std::move(box));
    }
    out.images.push_back(std::move(image));
  }
  return out;
}

DetectionFile cvat_video(const XmlFile& file) {
  DetectionFile out;
  out.form = DetectionForm::kCvatVideo;
  std::map<std::int64_t, DetectedImage> by_frame;
  for (const pugi::xml_node& track : file.root().children("track")) {
    const std::int64_t id = id_of(file, track);
    for (const pugi::xml_node& shape : track.children()) {
      if (shape.type() != pugi::node_element) continue;
      if (std::string(shape.name()) != "box") {
        ++out.other_shapes[shape.name()];
        continue;
      }
      const double frame = file.attribute_number(shape, "frame");
      if (!(frame >= 0.0 && frame <= 2e9))
        file.fail(shape, fmt::format("found frame {}, expected at least 0", frame));
      if (std::string(shape.attribute("outside").value()) == "1") continue;
      DetectedBox box;
      box.class_name = track.attribute("label").value();
      box.box = cvat_box(file, shape);
      box.track = id;
      by_frame[static_cast<std::int64_t>(frame)].boxes.push_back(std::move(box));
    }
  }
  for (auto& [frame, image] : by_frame) {
    image.number = frame;
    out.images.push_back(std::move(image));
  }
  return out;
}

}  // namespace

DetectionFile detections_of_xml(const std::string& text, const std::filesystem::path& path) {
  const XmlFile file = XmlFile::parse(text, path.string());
  const std::string root = file.root().name();
  if (root == "annotation") return voc(file);
  if (root == "annotations")
    return file.root().child("track") ? cvat_video(file) : cvat_images(file);
  if (root == "boost_serialization") {
    throw InputError(path.string(),
                     "found KITTI's tracklets, which are 3D boxes in the laser scanner's frame, "
                     "expected boxes in "
                     "images (label_02 of the tracking data has them)");
  }
  throw InputError(
      path.string(),
      fmt::format("found <{}>, expected <annotation> (Pascal VOC) or <annotations> (CVAT)",
                  printable(root)));
}

}  // namespace camber
