#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/detail/detection_forms.h"
#include "camber/import/kitti_labels.h"
#include "camber/import/text_rows.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kMaxPixel = 1e7;
constexpr double kMaxTrack = 9e15;       // whole numbers are exact in a double
constexpr double kLargestScore = 100.0;  // in per cent
constexpr double kThin = 2.0;            // pixels; a score or a class in the place of a box's side
constexpr double kShareMargin = 0.02;    // shares of boxes that stick out, rounded or by a detector

std::int64_t track_id(const DelimitedLines& lines, const DelimitedLine& line) {
  const double id = lines.number(line, 1, "a track's id");
  if (id != std::floor(id) || std::abs(id) > kMaxTrack) {
    lines.fail(line, 1,
               fmt::format("found '{}', expected a whole number", printable(line.fields[1])));
  }
  return static_cast<std::int64_t>(id);
}

/// Number of a column from 0 if it is whole and from `low` to `high`.
bool is_whole(const DelimitedLine& line, std::size_t column, double low, double high) {
  double value = 0.0;
  return column < line.fields.size() && parse_number(line.fields[column], &value) &&
         value == std::floor(value) && value >= low && value <= high;
}

/// Whether the columns from `first` on are those of VisDrone: class 0 to 11, truncation and
/// occlusion in steps (-1: none), and before them a score up to 1.
bool is_visdrone(const DelimitedLines& lines, std::size_t first) {
  const auto fits = [&](const DelimitedLine& line) {
    double score = 0.0;
    return line.fields.size() == first + 8 && parse_number(line.fields[first + 4], &score) &&
           score >= 0.0 && score <= 1.0 && is_whole(line, first + 5, 0.0, 11.0) &&
           is_whole(line, first + 6, -1.0, 1.0) && is_whole(line, first + 7, -1.0, 2.0);
  };
  const auto classed = [&](const DelimitedLine& line) {
    return is_whole(line, first + 5, 1.0, 11.0);
  };
  const auto& all = lines.lines();
  return std::all_of(all.begin(), all.end(), fits) && std::any_of(all.begin(), all.end(), classed);
}

DetectedBox visdrone_box(const DelimitedLines& lines, const DelimitedLine& line,
                         std::size_t first) {
  static const char* const kNames[] = {
      "ignored region", "pedestrian", "people",          "bicycle", "car",       "van",
      "truck",          "tricycle",   "awning-tricycle", "bus",     "motorbike", "other"};
  DetectedBox box;
  double side[4];
  for (std::size_t i = 0; i < 4; ++i) {
    side[i] = lines.number(line, first + i, "a box side in pixels");
    if (!(std::abs(side[i]) <= kMaxPixel) || (i > 1 && side[i] < 0.0)) {
      lines.fail(line, first + i,
                 fmt::format("found {}, expected pixels, of sizes not negative", side[i]));
    }
  }
  box.box = {side[0], side[1], side[0] + side[2], side[1] + side[3]};
  box.score = lines.number(line, first + 4, "a score");
  const int number = lines.integer(line, first + 5, 0, 11, "a class from 0 to 11");
  box.class_number = number;
  box.class_name = kNames[number];
  box.ignored = number == 0 || box.score == 0.0;
  return box;
}

DetectionFile visdrone(const DelimitedLines& lines, const std::string& stem) {
  DetectionFile out;
  out.form = DetectionForm::kVisDrone;
  out.images.emplace_back();
  out.images.back().file_name = stem;
  for (const DelimitedLine& line : lines.lines()) {
    out.images.back().boxes.push_back(visdrone_box(lines, line, 0));
  }
  return out;
}

DetectionFile visdrone_video(const DelimitedLines& lines) {
  DetectionFile out;
  out.form = DetectionForm::kVisDroneVideo;
  std::map<int, std::size_t> index;
  for (const DelimitedLine& line : lines.lines()) {
    const int frame = lines.integer(line, 0, 1, 2000000000, "a frame number from 1");
    if (index.emplace(frame, out.images.size()).second) {
      out.images.emplace_back();
      out.images.back().number = frame;
    }
    DetectedBox box = visdrone_box(lines, line, 2);
    box.track = track_id(lines, line);
    out.images[index[frame]].boxes.push_back(std::move(box));
  }
  return out;
}

/// frame, id, left, top, width, height[, score[, class or x[, visibility or y[, z]]]]
DetectionFile mot(const fs::path& path) {
  const DelimitedLines lines(path, ',');
  if (is_visdrone(lines, 0)) return visdrone(lines, path.stem().string());
  if (is_visdrone(lines, 2)) return visdrone_video(lines);
  DetectionFile out;
  std::size_t thin = 0;
  out.form = DetectionForm::kMot;
  std::map<std::int64_t, std::size_t> index;
  // MOT16 and later: truth has 9 columns, the 8th a class (3: car), and a score of 0 takes a row
  // out.
  const bool truth = !lines.lines().empty() && lines.lines().front().fields.size() == 9;
  for (const DelimitedLine& line : lines.lines()) {
    if (line.fields.size() < 6 || line.fields.size() > 10) {
      lines.fail(
          line,
          fmt::format("found {} columns, expected frame, id, left, top, width, height, score, ...",
                      line.fields.size()));
    }
    const int frame = lines.integer(line, 0, 1, 2000000000, "a frame number from 1 (MOT)");
    DetectedBox box;
    box.track = track_id(lines, line);
    double side[4];
    for (std::size_t i = 0; i < 4; ++i) {
      side[i] = lines.number(line, 2 + i, "a box side in pixels");
      if (!(std::abs(side[i]) <= kMaxPixel))
        lines.fail(line, 2 + i, "found more than 1e7 pixels, expected a box side");
    }
    if (side[2] < 0.0 || side[3] < 0.0) {
      lines.fail(line, 4,
                 fmt::format("found a box of {} x {} pixels, expected no negative size", side[2],
                             side[3]));
    }
    thin += side[2] < kThin || side[3] < kThin ? 1 : 0;
    box.box = {side[0], side[1], side[0] + side[2], side[1] + side[3]};
    if (line.fields.size() > 6) box.score = lines.number(line, 6, "a score");
    if (truth) {
      box.ignored = box.score == 0.0;
      const int number = lines.integer(line, 7, -1, 1000, "a class number");
      box.class_number = number;
      static const std::map<int, const char*> names = {{1, "pedestrian"},
                                                       {2, "person on vehicle"},
                                                       {3, "car"},
                                                       {4, "bicycle"},
                                                       {5, "motorbike"}};
      const auto name = names.find(number);
      box.class_name = name == names.end() ? "other" : name->second;
    }
    const auto [at, fresh] = index.emplace(frame, out.images.size());
    if (fresh) {
      out.images.emplace_back();
      out.images.back().number = frame;
    }
    out.images[at->second].boxes.push_back(std::move(box));
  }
  if (2 * thin > lines.lines().size()) {
    throw InputError(path.string(),
                     fmt::format("found boxes less than {} pixels wide or high in {} of {} rows, "
                                 "expected MOT's columns: frame, id, left, top, width, height, ...",
                                 kThin, thin, lines.lines().size()));
  }
  return out;
}

DetectionFile kitti(const fs::path& path) {
  const KittiLabelFile read = read_kitti_labels(path);
  DetectionFile out;
  const bool tracking = read.form == KittiLabelForm::kTracking;
  out.form = tracking ? DetectionForm::kKittiTracking : DetectionForm::kKittiObject;
  std::map<int, std::size_t> index;
  if (!tracking) {
    out.images.emplace_back();
    out.images.back().file_name = path.stem().string();
  }
  for (const KittiLabel& label : read.labels) {
    if (tracking && index.emplace(label.frame, out.images.size()).second) {
      out.images.emplace_back();
      out.images.back().number = label.frame;
    }
    DetectedBox box;
    box.class_name = label.type;
    box.box = label.box;
    box.score = label.score;
    box.track = label.track;
    box.ignored = label.dont_care();
    out.images[tracking ? index[label.frame] : 0].boxes.push_back(std::move(box));
  }
  return out;
}

/// Class of a row: a number, or a name.
void set_class(const TextRows& rows, const TextRow& row, DetectedBox* box) {
  double number = 0.0;
  if (!parse_number(row.words[0].text, &number)) {
    box->class_name = std::string(row.words[0].text);
  } else {
    box->class_number = rows.integer(row, row.words[0], 0, 1000000, "a class number from 0");
  }
}

/// Rows of class cx cy w h [score] [id], or class x1 y1 x2 y2 ... of a polygon, all in shares.
DetectedImage yolo(const TextRows& rows, const std::pair<int, int>& size) {
  DetectedImage out;
  out.width = size.first;
  out.height = size.second;
  for (const TextRow& row : rows.rows()) {
    std::vector<double> v;
    for (std::size_t i = 1; i < row.words.size(); ++i)
      v.push_back(rows.number(row, row.words[i], "a share of the image"));
    // Six values may be a box, its score and a track's id, a whole number.
    const bool polygon =
        v.size() >= 6 && v.size() % 2 == 0 && (v.size() > 6 || v.back() != std::floor(v.back()));
    const std::size_t shares = polygon ? v.size() : 4;
    if (v.size() < 4 || (!polygon && v.size() > 6)) {
      rows.fail(row, fmt::format(
                         "found {} columns, expected class cx cy width height [score] or a polygon",
                         row.words.size()));
    }
    for (std::size_t i = 0; i < shares; ++i) {
      if (!(v[i] >= -1.0 && v[i] <= 2.0))
        rows.fail(row, row.words[i + 1],
                  fmt::format("found {}, expected a share of the image", v[i]));
    }
    DetectedBox box;
    set_class(rows, row, &box);
    const double w = size.first, h = size.second;
    if (polygon) {
      box.box = {w * v[0], h * v[1], w * v[0], h * v[1]};
      for (std::size_t i = 2; i + 1 < v.size(); i += 2) {
        box.box.x1 = std::min(box.box.x1, w * v[i]);
        box.box.x2 = std::max(box.box.x2, w * v[i]);
        box.box.y1 = std::min(box.box.y1, h * v[i + 1]);
        box.box.y2 = std::max(box.box.y2, h * v[i + 1]);
      }
    } else {
      if (v[2] < 0.0 || v[3] < 0.0)
        rows.fail(row, "found a negative width or height, expected shares of the image");
      box.box = {w * (v[0] - 0.5 * v[2]), h * (v[1] - 0.5 * v[3]), w * (v[0] + 0.5 * v[2]),
                 h * (v[1] + 0.5 * v[3])};
      // A fifth share is a score; a larger whole number is a track's id.
      for (std::size_t i = 4; i < v.size(); ++i) {
        const bool id = v[i] > 1.0 || i == 5;
        if (id && (v[i] != std::floor(v[i]) || v[i] < 0.0 || v[i] > 2e9)) {
          rows.fail(row, row.words[i + 1],
                    fmt::format("found {}, expected a score up to 1 or a track's id", v[i]));
        }
        if (id) {
          box.track = static_cast<std::int64_t>(v[i]);
        } else {
          box.score = v[i];
        }
      }
    }
    out.boxes.push_back(std::move(box));
  }
  return out;
}

/// class score left top width height, pixels.
/// @param size  of the image, where it is known
DetectedImage absolute(const TextRows& rows, const std::optional<std::pair<int, int>>& size) {
  DetectedImage out;
  std::size_t thin = 0, beyond = 0, corners = 0;
  for (const TextRow& row : rows.rows()) {
    if (row.words.size() != 6) {
      rows.fail(row, fmt::format("found {} columns, expected class score left top width height",
                                 row.words.size()));
    }
    DetectedBox box;
    set_class(rows, row, &box);
    box.score = rows.number(row, row.words[1], "a score");
    double v[4];
    for (std::size_t i = 0; i < 4; ++i) {
      v[i] = rows.number(row, row.words[i + 2], "a box side in pixels");
      if (!(std::abs(v[i]) <= kMaxPixel))
        rows.fail(row, row.words[i + 2], "found more than 1e7 pixels, expected a box side");
    }
    if (v[2] < 0.0 || v[3] < 0.0)
      rows.fail(row, "found a negative width or height, expected pixels");
    thin += v[2] < kThin || v[3] < kThin || box.score > kLargestScore ? 1 : 0;
    corners += v[2] > v[0] && v[3] > v[1] ? 1 : 0;
    beyond += size && (v[0] + v[2] > size->first * (1.0 + kShareMargin) ||
                       v[1] + v[3] > size->second * (1.0 + kShareMargin))
                  ? 1
                  : 0;
    box.box = {v[0], v[1], v[0] + v[2], v[1] + v[3]};
    out.boxes.push_back(std::move(box));
  }
  if (2 * thin > rows.rows().size() || (corners == rows.rows().size() && 2 * beyond > corners)) {
    rows.fail(
        rows.rows().front(),
        fmt::format("found columns that are no class score left top width height ({} of {} "
                    "boxes are thin or scored beyond {}, {} reach out of the image), expected "
                    "these",
                    thin, rows.rows().size(), kLargestScore, beyond));
  }
  return out;
}

bool is_kitti_row(const TextRow& row) {
  double number = 0.0;
  const std::size_t count = row.words.size();
  if (count == 15 || count == 16) return !parse_number(row.words[0].text, &number);
  return (count == 17 || count == 18) && !parse_number(row.words[2].text, &number);
}

/// Whether the columns after the class (up to four) are shares of an image in every row.
bool all_shares(const TextRows& rows) {
  for (const TextRow& row : rows.rows()) {
    for (std::size_t i = 1; i < row.words.size() && i < 5; ++i) {
      double value = 0.0;
      if (parse_number(row.words[i].text, &value) && std::abs(value) > 1.0 + kShareMargin)
        return false;
    }
  }
  return true;
}

}  // namespace

DetectionFile detections_of_text(const fs::path& path, const DetectionOptions& options) {
  const TextRows rows(path);
  DetectionFile out;
  out.form = DetectionForm::kYolo;
  if (rows.rows().empty()) {  // an image without a box
    out.images.emplace_back();
    out.images.back().file_name = path.stem().string();
    return out;
  }
  const TextRow& first = rows.rows().front();
  if (is_kitti_row(first)) return kitti(path);
  if (first.words[0].text.find(',') != std::string_view::npos) return mot(path);
  if (all_shares(rows)) {
    const std::string stem = path.stem().string();
    const auto size = options.image_size ? options.image_size(stem) : std::nullopt;
    if (!size) {
      throw InputError(
          path.string(),
          "found boxes as shares of an image, expected the image that the file is named by");
    }
    out.images.push_back(yolo(rows, *size));
  } else {
    out.form = DetectionForm::kAbsoluteText;
    const std::string stem = path.stem().string();
    out.images.push_back(
        absolute(rows, options.image_size ? options.image_size(stem) : std::nullopt));
  }
  out.images.back().file_name = path.stem().string();
  return out;
}

}  // namespace camber
