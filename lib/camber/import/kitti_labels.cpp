#include "camber/import/kitti_labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/import/text_rows.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

constexpr int kMaxId = 2000000000;

/// Whether the row's first column is a number: then it is of the tracking form.
bool starts_with_number(const TextRow& row) {
  double ignored = 0.0;
  return parse_number(row.words[0].text, &ignored);
}

KittiLabel parse_label(const TextRows& text, const TextRow& row, KittiLabelForm form) {
  const bool tracking = form == KittiLabelForm::kTracking;
  const std::size_t columns = tracking ? 17 : 15;
  if (row.words.size() != columns && row.words.size() != columns + 1) {
    text.fail(
        row, fmt::format("found {} columns, expected {} (KITTI {} labels) or {} with a score",
                         row.words.size(), columns, tracking ? "tracking" : "object", columns + 1));
  }
  KittiLabel out;
  out.line = row.line;
  std::size_t at = 0;
  const auto word = [&]() -> const TextWord& { return row.words[at++]; };
  const auto number = [&](const char* what) { return text.number(row, word(), what); };
  if (tracking) {
    out.frame = text.integer(row, word(), 0, kMaxId, "a frame number");
    out.track = text.integer(row, word(), -1, kMaxId, "a track id, or -1");
  }
  const TextWord& type = word();
  double ignored = 0.0;
  if (parse_number(type.text, &ignored)) {
    text.fail(row, type, fmt::format("found '{}', expected a type like Car", printable(type.text)));
  }
  out.type = std::string(type.text);
  out.truncated = number("the truncation, a number");
  out.occluded = text.integer(row, word(), -1, 3, "the occlusion, an integer from -1 to 3");
  out.alpha = number("the observation angle alpha in radians");
  const TextWord& left = row.words[at];
  out.box.x1 = number("the box's left side in pixels");
  out.box.y1 = number("the box's upper side in pixels");
  out.box.x2 = number("the box's right side in pixels");
  out.box.y2 = number("the box's lower side in pixels");
  if (out.box.x1 > out.box.x2 || out.box.y1 > out.box.y2) {
    text.fail(row, left,
              fmt::format("found the box {} {} {} {}, expected left <= right and top <= bottom",
                          out.box.x1, out.box.y1, out.box.x2, out.box.y2));
  }
  out.height = number("the height in metres");
  out.width = number("the width in metres");
  out.length = number("the length in metres");
  out.location.x() = number("the location's x in metres");
  out.location.y() = number("the location's y in metres");
  out.location.z() = number("the location's z in metres");
  out.rotation_y = number("rotation_y in radians");
  if (at < row.words.size()) out.score = number("a score");
  return out;
}

}  // namespace

KittiLabelFile read_kitti_labels(const std::filesystem::path& path) {
  const TextRows text(path);
  KittiLabelFile out;
  if (text.rows().empty()) return out;
  out.form =
      starts_with_number(text.rows().front()) ? KittiLabelForm::kTracking : KittiLabelForm::kObject;
  out.labels.reserve(text.rows().size());
  for (const TextRow& row : text.rows()) out.labels.push_back(parse_label(text, row, out.form));
  return out;
}

void write_kitti_labels(const KittiLabelFile& file, const std::filesystem::path& path) {
  const bool scores = std::any_of(file.labels.begin(), file.labels.end(),
                                  [](const KittiLabel& l) { return !std::isnan(l.score); });
  std::string out;
  for (const KittiLabel& l : file.labels) {
    if (l.type.empty() || l.type.find_first_of(" \t\r\n\v\f") != std::string::npos) {
      throw std::invalid_argument("KITTI label type '" + printable(l.type) +
                                  "', expected one word without blanks");
    }
    if (file.form == KittiLabelForm::kTracking) out += fmt::format("{} {} ", l.frame, l.track);
    out += fmt::format(
        "{} {:.6f} {} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} "
        "{:.6f}",
        l.type, l.truncated, l.occluded, l.alpha, l.box.x1, l.box.y1, l.box.x2, l.box.y2, l.height,
        l.width, l.length, l.location.x(), l.location.y(), l.location.z(), l.rotation_y);
    if (scores) out += fmt::format(" {:.6f}", std::isnan(l.score) ? 1.0 : l.score);
    out += '\n';
  }
  write_file_atomically(path, out);
}

}  // namespace camber
