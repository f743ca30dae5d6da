#include "camber/pipeline/detection_cache.h"

#include <system_error>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/image/image_io.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

constexpr std::size_t kMostBytes = std::size_t{1} << 26;

/// The document of an entry, read by `read`; nothing where there is none, or it is damaged.
template <typename Read>
auto read_entry(const fs::path& path, const Read& read)
    -> std::optional<decltype(read(std::declval<const JsonCursor&>()))> {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return std::nullopt;
  try {
    const json document = parse_json(read_whole_file(path, kMostBytes), path.string());
    JsonContext context{path.string(), {}};
    return read(JsonCursor(document, context));
  } catch (const Error&) {
    return std::nullopt;
  }
}

}  // namespace

template <typename Write>
void DetectionCache::put(const fs::path& path, const Write& write) const {
  if (folder_.empty()) return;
  try {
    fs::create_directories(folder_);
    write(path);
  } catch (const Error&) {  // it stays as it was
  } catch (const fs::filesystem_error&) {
  }
}

std::optional<std::vector<DetectedVehicle>> DetectionCache::find_boxes(
    const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  return read_entry(folder_ / (key + ".json"), [](const JsonCursor& cursor) {
    std::vector<DetectedVehicle> out;
    for (const JsonCursor& item : cursor.items("an array of boxes")) {
      JsonObject object(item);
      const std::vector<double> box = object.require("box", "4 numbers").numbers(4, "4 numbers");
      out.push_back({object.require("class", "a class").text(),
                     object.require("score", "a number").number(),
                     {box[0], box[1], box[2], box[3]}});
    }
    return out;
  });
}

void DetectionCache::put_boxes(const std::string& key,
                               const std::vector<DetectedVehicle>& boxes) const {
  json out = json::array();
  for (const DetectedVehicle& v : boxes) {
    out.push_back({{"class", v.vehicle_class},
                   {"score", v.score},
                   {"box", {v.box.x1, v.box.y1, v.box.x2, v.box.y2}}});
  }
  put(folder_ / (key + ".json"),
      [&](const fs::path& path) { write_file_atomically(path, format_json(out)); });
}

std::optional<Image> DetectionCache::find_labels(const std::string& key, int width,
                                                 int height) const {
  const fs::path path = folder_ / (key + ".png");
  std::error_code error;
  if (folder_.empty() || !fs::is_regular_file(path, error)) return std::nullopt;
  try {
    PinholeCamera size;
    size.width = width;
    size.height = height;
    return read_label_image(path, size);
  } catch (const Error&) {
    return std::nullopt;
  }
}

void DetectionCache::put_labels(const std::string& key, const Image& labels) const {
  put(folder_ / (key + ".png"), [&](const fs::path& path) { write_png(labels, path); });
}

std::optional<std::string> DetectionCache::find_word(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  return read_entry(folder_ / (key + ".json"),
                    [](const JsonCursor& cursor) { return cursor.text(); });
}

void DetectionCache::put_word(const std::string& key, const std::string& word) const {
  put(folder_ / (key + ".json"),
      [&](const fs::path& path) { write_file_atomically(path, format_json(word)); });
}

}  // namespace camber
