#include "camber/import/formats/map_boxes.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/feather.h"
#include "camber/import/text_rows.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

/// A quaternion that is one up to rounding, made exactly so.
std::optional<Eigen::Quaterniond> unit(double w, double x, double y, double z) {
  const Eigen::Quaterniond q(w, x, y, z);
  if (!(std::abs(q.norm() - 1.0) < 0.01)) return std::nullopt;
  return q.normalized();
}

/// A table as text: a CSV file, or a Feather file's columns.
class TextTable {
 public:
  explicit TextTable(const fs::path& path) : file_(path.string()), feather_(is_feather(path)) {
    if (feather_) {
      take(read_feather(path));
    } else {
      take(DelimitedLines(path, ','));
    }
    for (std::size_t i = 0; i < names_.size(); ++i) index_[lower_case(names_[i])] = i;
  }

  const std::vector<std::string>& names() const { return names_; }
  const std::vector<std::vector<std::string>>& rows() const { return rows_; }
  bool empty() const { return names_.empty(); }

  /// The first of two names that is there. @throws InputError.
  std::size_t required(const std::string& name, const std::string& other = {}) const {
    for (const std::string& key : {name, other}) {
      const auto found = index_.find(key);
      if (found != index_.end()) return found->second;
    }
    throw InputError(file_, feather_ ? "its columns" : "line 1",
                     fmt::format("found no column {}{}, expected a table of Argoverse 2", name,
                                 other.empty() ? "" : " or " + other));
  }
  std::optional<std::size_t> optional(const std::string& name) const {
    const auto found = index_.find(name);
    return found == index_.end() ? std::nullopt : std::optional(found->second);
  }

  /// @throws InputError "file: line L, field F: reason", of a Feather file "row R, column NAME".
  [[noreturn]] void fail(std::size_t row, std::size_t field, const std::string& reason) const {
    throw InputError(file_,
                     feather_ ? fmt::format("row {}, column {}", row + 1, printable(names_[field]))
                              : fmt::format("line {}, field {}", lines_[row], field + 1),
                     reason);
  }
  const std::string& text(std::size_t row, std::size_t field) const {
    if (field >= rows_[row].size()) {
      throw InputError(file_, fmt::format("line {}", lines_[row]), "found fewer fields than names");
    }
    return rows_[row][field];
  }
  double number(std::size_t row, std::size_t field, const char* expectation) const {
    double value = 0.0;
    const std::string& found = text(row, field);
    if (!parse_number(found, &value) || !std::isfinite(value)) {
      fail(row, field, fmt::format("found '{}', expected {}", printable(found), expectation));
    }
    return value;
  }
  std::int64_t stamp(std::size_t row, std::size_t field) const {
    const std::string& found = text(row, field);
    std::size_t used = 0;
    try {
      const long long value = std::stoll(found, &used);
      if (used == found.size() && value >= 0) return value;
    } catch (const std::exception&) {
    }
    fail(row, field, "found '" + printable(found) + "', expected nanoseconds");
  }

 private:
  void take(const DelimitedLines& table) {
    for (const DelimitedLine& line : table.lines()) {
      const bool first = &line == &table.lines().front();
      std::vector<std::string>& row = first ? names_ : rows_.emplace_back();
      for (const std::string_view field : line.fields) row.emplace_back(field);
      if (!first) lines_.push_back(line.line);
    }
  }
  void take(const FeatherTable& table) {
    const auto taken = [](const FeatherColumn& column) {
      return column.kind != FeatherColumn::Kind::kOther;
    };
    for (const FeatherColumn& column : table.columns) {
      if (taken(column)) names_.push_back(column.name);
    }
    if (names_.empty()) return;
    for (std::size_t r = 0; r < table.rows; ++r) {
      std::vector<std::string>& row = rows_.emplace_back();
      for (const FeatherColumn& column : table.columns) {
        if (taken(column)) row.push_back(with_double_quotes(column.text(r)));
      }
    }
  }
  /// As a field of CSV has them within quotes.
  static std::string with_double_quotes(std::string text) {
    for (std::size_t i = text.find('"'); i != std::string::npos; i = text.find('"', i + 2)) {
      text.insert(i, 1, '"');
    }
    return text;
  }

  std::string file_;
  bool feather_;
  std::vector<std::string> names_;
  std::vector<std::vector<std::string>> rows_;
  std::vector<int> lines_;  // of the rows, of CSV
  std::map<std::string, std::size_t> index_;
};

/// Where a pose's numbers stand.
struct PoseColumns {
  std::size_t q[4], t[3];

  explicit PoseColumns(const TextTable& table)
      : q{table.required("qw"), table.required("qx"), table.required("qy"), table.required("qz")},
        t{table.required("tx_m", "x_m"), table.required("ty_m", "y_m"),
          table.required("tz_m", "z_m")} {}

  SE3 read(const TextTable& table, std::size_t row) const {
    const auto number = [&](std::size_t field) { return table.number(row, field, "a number"); };
    const auto rotation = unit(number(q[0]), number(q[1]), number(q[2]), number(q[3]));
    if (!rotation) table.fail(row, q[0], "expected a quaternion of length 1");
    return SE3(*rotation, {number(t[0]), number(t[1]), number(t[2])});
  }
};

}  // namespace

struct MapBoxFile::Content {
  // nuScenes
  json document;
  std::vector<json::json_pointer> places;
  // Argoverse 2
  std::vector<std::vector<std::string>> rows;  // of them the first: the names
  std::size_t q[4] = {0, 0, 0, 0}, t[3] = {0, 0, 0};
  bool table = false;
};

MapBoxFile::MapBoxFile() : content_(std::make_unique<Content>()) {}
MapBoxFile::~MapBoxFile() = default;
MapBoxFile::MapBoxFile(MapBoxFile&&) noexcept = default;

const char* MapBoxFile::form() const { return content_->table ? "argoverse2" : "nuscenes"; }

namespace {

MapBox json_box(const JsonCursor& cursor) {
  JsonObject object(cursor, "a box");
  MapBox out;
  const auto numbers = [&](const char* key, std::size_t count, const char* what) {
    return object.require(key, what).numbers(count, what);
  };
  const std::vector<double> center = numbers("translation", 3, "3 numbers [x, y, z]");
  const JsonCursor size = object.require("size", "3 numbers [width, length, height]");
  const std::vector<double> sizes = size.numbers(3, "3 numbers [width, length, height]");
  const JsonCursor turn = object.require("rotation", "4 numbers [w, x, y, z]");
  const std::vector<double> q = turn.numbers(4, "4 numbers [w, x, y, z]");
  const auto rotation = unit(q[0], q[1], q[2], q[3]);
  if (!rotation) turn.fail("a quaternion of length 1");
  for (const double side : sizes) {
    if (!(side > 0.0)) size.fail("sizes above 0");
  }
  out.center = {center[0], center[1], center[2]};
  out.width = sizes[0];
  out.length = sizes[1];
  out.height = sizes[2];
  out.rotation = *rotation;
  for (const char* key : {"detection_name", "category_name", "tracking_name"}) {
    if (const auto name = object.find(key)) out.category = name->text();
  }
  return out;
}

}  // namespace

MapBoxFile MapBoxFile::read(const fs::path& path) {
  MapBoxFile out;
  Content& content = *out.content_;
  const std::string text = is_feather(path) ? std::string() : read_whole_file(path);
  const auto first = text.find_first_not_of(" \t\r\n");
  if (first != std::string::npos && (text[first] == '{' || text[first] == '[')) {
    content.document = parse_json(text, path.string());
    JsonContext context{path.string(), {}};
    const JsonCursor root(content.document, context);
    const auto take = [&](const JsonCursor& list, const json::json_pointer& at) {
      std::size_t i = 0;
      for (const JsonCursor& item : list.items("a list of boxes")) {
        out.boxes_.push_back(json_box(item));
        content.places.push_back(at / i++);
      }
    };
    if (content.document.is_array()) {
      take(root, json::json_pointer());
    } else {
      JsonObject object(root);
      JsonObject samples(object.require("results", "boxes by sample, as nuScenes has them"));
      for (const auto& [token, list] : samples.entries()) {
        take(list, json::json_pointer() / "results" / token);
      }
    }
    return out;
  }
  content.table = true;
  const TextTable table(path);
  if (table.empty()) throw InputError(path.string(), "found no rows, expected boxes");
  const PoseColumns pose(table);
  std::copy(std::begin(pose.q), std::end(pose.q), content.q);
  std::copy(std::begin(pose.t), std::end(pose.t), content.t);
  const std::size_t sizes[] = {table.required("length_m"), table.required("width_m"),
                               table.required("height_m")};
  const auto time = table.optional("timestamp_ns"), category = table.optional("category");
  content.rows.push_back(table.names());
  for (std::size_t r = 0; r < table.rows().size(); ++r) {
    const std::vector<std::string>& row = content.rows.emplace_back(table.rows()[r]);
    MapBox box;
    const SE3 at = pose.read(table, r);
    box.center = at.translation();
    box.rotation = at.rotation();
    double* const sides[] = {&box.length, &box.width, &box.height};
    for (int i = 0; i < 3; ++i) {
      *sides[i] = table.number(r, sizes[i], "metres");
      if (!(*sides[i] > 0.0)) table.fail(r, sizes[i], "expected a size above 0");
    }
    if (time && *time < row.size()) box.timestamp = table.stamp(r, *time);
    if (category && *category < row.size()) box.category = row[*category];
    out.boxes_.push_back(std::move(box));
  }
  return out;
}

std::string MapBoxFile::encoded(const std::vector<MapBox>& boxes,
                                const std::vector<MapBoxNote>& notes) const {
  if (boxes.size() != boxes_.size() || notes.size() != boxes_.size()) {
    throw std::invalid_argument("boxes, notes: expected one for each box of the file");
  }
  if (!content_->table) {
    json document = content_->document;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      json& at = document.at(content_->places[i]);
      const Eigen::Quaterniond& q = boxes[i].rotation;
      at["translation"] = {boxes[i].center.x(), boxes[i].center.y(), boxes[i].center.z()};
      at["rotation"] = {q.w(), q.x(), q.y(), q.z()};
      at["camber_status"] = notes[i].status;
      at["camber_reason"] = notes[i].reason;
      at["camber_height_sigma"] = number_json(notes[i].height_sigma);
    }
    return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
  }
  std::string out;
  const auto field = [](const std::string& text) {
    return text.find_first_of(",\"\n") == std::string::npos ? text : '"' + text + '"';
  };
  for (std::size_t r = 0; r < content_->rows.size(); ++r) {
    std::vector<std::string> row = content_->rows[r];
    std::string end = ",camber_status,camber_reason,camber_height_sigma_m\n";
    if (r > 0) {
      const MapBox& box = boxes[r - 1];
      const Eigen::Quaterniond& q = box.rotation;
      const double turn[] = {q.w(), q.x(), q.y(), q.z()};
      for (int i = 0; i < 4; ++i) row[content_->q[i]] = fmt::format("{:.9g}", turn[i]);
      for (int i = 0; i < 3; ++i) row[content_->t[i]] = fmt::format("{:.6f}", box.center[i]);
      const MapBoxNote& note = notes[r - 1];
      end = fmt::format(",{},{},{}\n", note.status, field(note.reason),
                        std::isfinite(note.height_sigma) ? fmt::format("{:.4f}", note.height_sigma)
                                                         : std::string());
    }
    for (std::size_t i = 0; i < row.size(); ++i) out += (i > 0 ? "," : "") + field(row[i]);
    out += end;
  }
  return out;
}

std::map<std::int64_t, SE3> read_stamped_poses(const fs::path& path) {
  const TextTable table(path);
  if (table.empty()) throw InputError(path.string(), "found no rows, expected poses");
  const PoseColumns pose(table);
  const std::size_t time = table.required("timestamp_ns");
  std::map<std::int64_t, SE3> out;
  for (std::size_t r = 0; r < table.rows().size(); ++r) {
    out[table.stamp(r, time)] = pose.read(table, r);
  }
  return out;
}

}  // namespace camber
