#include <fmt/format.h>

#include <cmath>
#include <unordered_map>

#include "camber/core/errors.h"
#include "camber/import/formats/detail/detection_forms.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

using nlohmann::json;

constexpr double kMaxPixel = 1e7;

std::int64_t whole(const JsonCursor& cursor, const char* expectation) {
  const double value = cursor.number(expectation);
  if (!(std::abs(value) < 9e15) || value != std::floor(value)) cursor.fail(expectation);
  return static_cast<std::int64_t>(value);
}

/// An id that may be written as text: "000042".
std::int64_t id_of(const JsonCursor& cursor) {
  if (!cursor.value().is_string()) return whole(cursor, "a whole number");
  const std::string& text = cursor.text();
  if (text.empty() || text.size() > 15 ||
      text.find_first_not_of("0123456789") != std::string::npos) {
    cursor.fail("a whole number");
  }
  return std::stoll(text);
}

int side_of(const JsonCursor& cursor) {
  return cursor.integer(1, 65535, "a number of pixels from 1 to 65535");
}

/// x, y, width, height.
Box2 coco_box(const JsonCursor& cursor) {
  const std::vector<double> v = cursor.numbers(4, "4 numbers [x, y, width, height]");
  for (const double value : v) {
    if (!(std::abs(value) <= kMaxPixel)) cursor.fail("pixels within 1e7");
  }
  if (v[2] < 0.0 || v[3] < 0.0)
    cursor.fail_because(
        fmt::format("found a box of {} x {} pixels, expected no negative size", v[2], v[3]));
  return {v[0], v[1], v[0] + v[2], v[1] + v[3]};
}

DetectedBox coco_annotation(JsonObject& object) {
  DetectedBox out;
  out.box = coco_box(object.require("bbox", "4 numbers [x, y, width, height]"));
  out.class_number = whole(object.require("category_id", "a category's id"), "a category's id");
  if (auto v = object.find("score")) out.score = v->number();
  if (auto v = object.find("track_id")) out.track = id_of(*v);
  if (auto v = object.find("iscrowd")) out.ignored = v->value() == 1 || v->value() == true;
  return out;
}

/// Whether an object without a box is one of COCO that has something else.
bool has_other_shape(JsonObject& object) {
  for (const char* const key : {"segmentation", "keypoints", "caption", "densepose"}) {
    if (object.find(key)) return true;
  }
  return false;
}

/// An image's id: a number, also as text ("000042"), or the name of its file, as some detectors
/// write.
struct ImageId {
  std::string key;  // one an image
  std::optional<std::int64_t> number;
};
ImageId image_id(const JsonCursor& cursor) {
  const json& value = cursor.value();
  const bool name =
      value.is_string() && !value.get_ref<const std::string&>().empty() &&
      (value.get_ref<const std::string&>().size() > 15 ||
       value.get_ref<const std::string&>().find_first_not_of("0123456789") != std::string::npos);
  if (name) return {cursor.text(), std::nullopt};
  const std::int64_t number = id_of(cursor);
  return {std::to_string(number), number};
}

DetectionFile coco_results(const JsonCursor& root) {
  const char* const expectation =
      "a detection {\"image_id\", \"category_id\", \"bbox\", \"score\"}";
  DetectionFile out;
  out.form = DetectionForm::kCocoResults;
  std::unordered_map<std::string, std::size_t> index;
  for (const JsonCursor& cursor : root.items("an array of detections")) {
    JsonObject object(cursor, expectation);
    if (!object.find("bbox")) {
      if (!object.find("image_id") || !has_other_shape(object)) {
        cursor.fail_because(fmt::format("found no bbox, expected {}", expectation));
      }
      ++out.other_shapes["detection without a box"];
      continue;
    }
    const ImageId image = image_id(object.require("image_id", "an image's id"));
    const auto file = object.find("file_name");
    const auto [at, fresh] = index.emplace(image.key, out.images.size());
    if (fresh) {
      out.images.emplace_back();
      out.images.back().number = image.number;
      out.images.back().file_name = file ? file->text() : image.number ? "" : image.key;
    }
    out.images[at->second].boxes.push_back(coco_annotation(object));
  }
  return out;
}

DetectionFile coco_dataset(JsonObject& root) {
  DetectionFile out;
  out.form = DetectionForm::kCocoDataset;
  if (auto categories = root.find("categories")) {
    for (const JsonCursor& cursor : categories->items("an array of categories")) {
      JsonObject category(cursor, "a category {\"id\", \"name\"}");
      const std::int64_t id = whole(category.require("id", "a whole number"), "a whole number");
      out.classes[id] = category.require("name", "a name").text();
    }
  }
  std::unordered_map<std::string, std::size_t> index;
  for (const JsonCursor& cursor :
       root.require("images", "an array of images").items("an array of images")) {
    JsonObject image(cursor, "an image {\"id\", \"file_name\"}");
    DetectedImage one;
    const ImageId id = image_id(image.require("id", "a whole number or a name"));
    one.number = id.number;
    one.file_name = image.require("file_name", "a file name").text();
    if (auto v = image.find("width")) one.width = side_of(*v);
    if (auto v = image.find("height")) one.height = side_of(*v);
    if (!index.emplace(id.key, out.images.size()).second) {
      cursor.fail_because(fmt::format("found the id {} a second time, expected ids that differ",
                                      printable(id.key)));
    }
    out.images.push_back(std::move(one));
  }
  for (const JsonCursor& cursor :
       root.require("annotations", "an array of annotations").items("an array of annotations")) {
    JsonObject object(cursor, "an annotation {\"image_id\", \"category_id\", \"bbox\"}");
    const auto box = object.find("bbox");
    if (!box || (box->value().is_array() && box->value().empty())) {
      if (!box && (!object.find("image_id") || !has_other_shape(object))) {
        cursor.fail_because(
            "found no bbox, expected an annotation {\"image_id\", \"category_id\", \"bbox\"}");
      }
      ++out.other_shapes["annotation without a box"];
      continue;
    }
    const JsonCursor image = object.require("image_id", "an image's id");
    const auto at = index.find(image_id(image).key);
    if (at == index.end()) image.fail("the id of one of the images");
    out.images[at->second].boxes.push_back(coco_annotation(object));
  }
  return out;
}

/// box2d of BDD100K and Scalabel.
std::optional<Box2> bdd_box(const JsonCursor& cursor) {
  JsonObject box(cursor, "a box {\"x1\", \"y1\", \"x2\", \"y2\"}");
  const auto side = [&](const char* key) {
    return box.require(key, "pixels").in_range(-kMaxPixel, kMaxPixel, "pixels within 1e7");
  };
  const Box2 out{side("x1"), side("y1"), side("x2"), side("y2")};
  if (out.x1 > out.x2 || out.y1 > out.y2) {
    cursor.fail_because(
        fmt::format("found a box from {}, {} to {}, {}, expected x1 <= x2 and y1 <= y2", out.x1,
                    out.y1, out.x2, out.y2));
  }
  return out;
}

/// Labels of one image; ids that are no numbers get numbers by their first appearance.
void bdd_labels(const JsonCursor& labels, std::unordered_map<std::string, std::int64_t>* tracks,
                DetectedImage* image, DetectionFile* out) {
  for (const JsonCursor& cursor : labels.items("an array of labels")) {
    JsonObject label(cursor, "a label {\"category\", \"box2d\"}");
    const auto box = label.find("box2d");
    if (!box) {
      label.require("category", "a category");  // of BDD100K each label has one
      const char* kind = label.find("poly2d")  ? "poly2d"
                         : label.find("box3d") ? "box3d"
                                               : "label without a box";
      ++out->other_shapes[kind];
      continue;
    }
    DetectedBox one;
    one.box = *bdd_box(*box);
    one.class_name = label.require("category", "a category").text();
    if (auto v = label.find("score")) one.score = v->number();
    if (auto v = label.find("id")) {
      const std::string id = v->value().is_string() ? v->text() : v->value().dump();
      one.track = tracks->emplace(id, static_cast<std::int64_t>(tracks->size())).first->second;
    }
    image->boxes.push_back(std::move(one));
  }
}

DetectionFile bdd(const JsonCursor& frames) {
  DetectionFile out;
  out.form = DetectionForm::kBdd;
  std::unordered_map<std::string, std::int64_t> tracks;
  bool by_video = false, labelled = false;
  for (const JsonCursor& cursor : frames.items("an array of frames")) {
    JsonObject frame(cursor, "a frame {\"name\", \"labels\"}");
    DetectedImage image;
    if (auto v = frame.find("name")) image.file_name = v->text();
    for (const char* key : {"frameIndex", "index"}) {
      if (auto v = frame.find(key)) image.number = whole(*v, "a frame number");
    }
    by_video |= frame.find("videoName").has_value();
    if (auto v = frame.find("size")) {
      JsonObject size(*v);
      image.width = side_of(size.require("width", "pixels"));
      image.height = side_of(size.require("height", "pixels"));
    }
    for (const char* const key : {"labels", "objects"}) {
      const auto v = frame.find(key);
      if (v) bdd_labels(*v, &tracks, &image, &out);
      labelled |= cursor.value().contains(key);  // null where there are none
    }
    if (auto old = frame.find("frames")) {
      labelled = true;  // the first form: one object per image, objects within
      for (const JsonCursor& inner : old->items("an array of frames")) {
        JsonObject within(inner);
        if (auto v = within.find("objects")) bdd_labels(*v, &tracks, &image, &out);
      }
    }
    out.images.push_back(std::move(image));
  }
  if (!labelled && !out.images.empty()) {
    frames.fail("frames {\"name\", \"labels\"} of BDD100K, or a COCO list of results");
  }
  if (by_video) return out;
  // Ids of single images join nothing.
  for (DetectedImage& image : out.images) {
    for (DetectedBox& box : image.boxes) box.track = -1;
  }
  return out;
}

bool looks_like_bdd(const json& items) {
  return items.is_array() && !items.empty() && items[0].is_object() &&
         (items[0].contains("labels") || items[0].contains("frames") ||
          (items[0].contains("name") && !items[0].contains("bbox")));
}

}  // namespace

DetectionFile detections_of_json(const std::string& text, const std::filesystem::path& path) {
  JsonContext context;
  context.file = path.string();
  const json document = parse_json(text, path.string());
  const JsonCursor root(document, context);
  if (looks_like_bdd(document)) return bdd(root);
  if (document.is_array()) return coco_results(root);
  JsonObject object(root, "boxes in the form of COCO or BDD100K");
  if (document.contains("frames")) return bdd(*object.find("frames"));
  // BDD100K's first form has a file an image.
  if (document.contains("labels") || document.contains("objects")) {
    const json list = json::array({document});
    return bdd(JsonCursor(list, context));
  }
  if (!document.contains("annotations") && document.contains("images") &&
      document.contains("categories")) {
    object.require("annotations", "an array of annotations");
  }
  if (!document.contains("images"))
    root.fail("a COCO data set or list of results, or BDD100K's frames");
  return coco_dataset(object);
}

}  // namespace camber
