#include "camber/scene/json_reader.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include "camber/core/errors.h"

namespace camber {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxDepth = 64;
constexpr double kUnitTolerance = 1e-3;

std::string key_path(const std::string& parent, const std::string& key) {
  return parent.empty() ? printable(key) : parent + "." + printable(key);
}

/// Builds the document from parser events, so that duplicate keys, deep nesting and overflowing
/// numbers can be refused where they stand.
class DocumentBuilder {
 public:
  DocumentBuilder(const std::string& text, const std::string& file) : text_(text), file_(file) {}

  json take() { return std::move(root_); }

  bool null() { return put(nullptr); }
  bool boolean(bool value) { return put(value); }
  bool number_integer(json::number_integer_t value) { return put(value); }
  bool number_unsigned(json::number_unsigned_t value) { return put(value); }
  bool number_float(json::number_float_t value, const json::string_t&) { return put(value); }
  bool string(json::string_t& value) { return put(std::move(value)); }
  bool binary(json::binary_t&) { return false; }  // does not occur in text
  bool start_object(std::size_t) { return open(json::object()); }
  bool start_array(std::size_t) { return open(json::array()); }
  bool end_object() {
    stack_.pop_back();
    return true;
  }
  bool end_array() { return end_object(); }
  bool key(json::string_t& name) {
    json& object = *stack_.back();
    if (object.contains(name)) {
      throw InputError(file_, key_path(path(), name), "the key stands twice, expected once");
    }
    key_ = name;
    return true;
  }
  bool parse_error(std::size_t position, const std::string&,
                   const nlohmann::detail::exception& error) {
    // The parser has read `position` bytes, the last of which is wrong or ends what is wrong; the
    // end of the file counts as one byte more. Take the whole word around that byte.
    const auto is_word = [](char c) {
      return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '+' || c == '-' ||
             c == '.';
    };
    const bool at_end = position > text_.size() || text_.empty();
    std::size_t start = at_end ? text_.size() : position - (position > 0 ? 1 : 0);
    std::size_t end = at_end ? start : start + 1;
    if (!at_end && is_word(text_[start])) {
      while (start > 0 && is_word(text_[start - 1])) --start;
      while (end < text_.size() && is_word(text_[end])) ++end;
    }
    const std::size_t line =
        1 + static_cast<std::size_t>(std::count(
                text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(start), '\n'));
    const std::size_t line_break = start == 0 ? std::string::npos : text_.rfind('\n', start - 1);
    const std::size_t line_start = line_break == std::string::npos ? 0 : line_break + 1;
    const std::string word = text_.substr(start, end - start);
    const std::string found = at_end         ? "the end of the file"
                              : word == "\"" ? "a string"
                                             : "'" + printable(word) + "'";
    const std::string message = error.what();
    std::string detail, expected = "valid JSON";
    if (const auto at = message.rfind("; expected "); at != std::string::npos) {
      expected = printable(message.substr(at + 11), 60);
    }
    if (const auto at = message.find(" - invalid "); at != std::string::npos) {
      const std::string tail = message.substr(at + 3);
      detail = printable(tail.substr(0, tail.find("; last read")), 120) + ", ";
    }
    if (word == "NaN" || word == "-NaN" || word == "Infinity" || word == "-Infinity" ||
        message.find("number overflow") != std::string::npos) {
      detail.clear();
      expected = "a finite number";
    }
    throw InputError(
        file_, fmt::format("line {}, column {} (byte {})", line, start - line_start + 1, start + 1),
        fmt::format("{}found {}, expected {}", detail, found, expected));
  }

 private:
  template <class Value>
  bool put(Value&& value) {
    add(json(std::forward<Value>(value)));
    return true;
  }
  json* add(json&& value) {
    if (stack_.empty()) {
      root_ = std::move(value);
      return &root_;
    }
    json& parent = *stack_.back();
    if (parent.is_array()) {
      parent.push_back(std::move(value));
      return &parent.back();
    }
    return &(parent[key_] = std::move(value));
  }
  bool open(json&& value) {
    if (stack_.size() >= kMaxDepth) {
      throw InputError(
          file_, path(),
          fmt::format("nested deeper than {} levels, expected a Camber document", kMaxDepth));
    }
    names_.resize(stack_.size());
    names_.push_back(key_);
    stack_.push_back(add(std::move(value)));
    return true;
  }
  /// The path of the innermost open object or array.
  std::string path() const {
    std::string out;
    for (std::size_t i = 1; i < stack_.size(); ++i) {
      if (stack_[i - 1]->is_array()) {
        out += "[" + std::to_string(stack_[i - 1]->size() - 1) + "]";
      } else {
        out = key_path(out, names_[i]);
      }
    }
    return out.empty() ? "top level" : out;
  }

  const std::string& text_;
  const std::string& file_;
  json root_;
  std::vector<json*> stack_;
  std::vector<std::string> names_;
  std::string key_;
};

std::string scalar_text(const json& value) {
  return value.dump(-1, ' ', false, json::error_handler_t::replace);
}

void append_json(const json& value, std::size_t indent, std::string& out) {
  const bool object = value.is_object();
  if (!value.is_structured() || value.empty()) {
    out += scalar_text(value);
    return;
  }
  const bool plain = !object && std::none_of(value.begin(), value.end(),
                                             [](const json& v) { return v.is_structured(); });
  const std::string line = plain ? "" : "\n" + std::string(indent + 2, ' ');
  out += object ? '{' : '[';
  bool first = true;
  for (auto at = value.begin(); at != value.end(); ++at) {
    if (!first) out += plain ? ", " : ",";
    first = false;
    out += line;
    if (object) out += scalar_text(at.key()) + ": ";
    append_json(*at, indent + 2, out);
  }
  if (!plain) out += "\n" + std::string(indent, ' ');
  out += object ? '}' : ']';
}

}  // namespace

std::string format_json(const json& value) {
  std::string out;
  append_json(value, 0, out);
  return out + "\n";
}

nlohmann::json parse_json(const std::string& text, const std::string& file) {
  DocumentBuilder builder(text, file);
  json::sax_parse(text, &builder);
  return builder.take();
}

void JsonContext::report_unknown(const LogSink& warn) const {
  if (!warn) return;
  for (const auto& [pattern, place] : unknown) {
    const auto& [path, more] = place;
    warn(fmt::format(
        "{}: {}: unknown key, ignored{}", file, path,
        more > 0 ? fmt::format(" (and in {} more place{})", more, more == 1 ? "" : "s") : ""));
  }
}

void JsonCursor::fail(const std::string& expectation) const {
  fail_because("found " + describe() + ", expected " + expectation);
}

void JsonCursor::fail_because(const std::string& reason) const {
  throw InputError(context_->file, path_.empty() ? "top level" : path_, reason);
}

std::string JsonCursor::describe() const {
  const json& v = *value_;
  switch (v.type()) {
    case json::value_t::null:
      return "null";
    case json::value_t::boolean:
      return v.get<bool>() ? "true" : "false";
    case json::value_t::string:
      return "\"" + printable(v.get_ref<const std::string&>()) + "\"";
    case json::value_t::object:
      return "an object";
    case json::value_t::array: {
      const bool all = std::all_of(v.begin(), v.end(), [](const json& e) { return e.is_number(); });
      if (v.empty()) return "an empty array";
      return all ? fmt::format("{} number{}", v.size(), v.size() == 1 ? "" : "s")
                 : fmt::format("an array of {} value{}", v.size(), v.size() == 1 ? "" : "s");
    }
    default:
      return v.dump();
  }
}

double JsonCursor::number(const char* expectation) const {
  if (!value_->is_number()) fail(expectation);
  const double v = value_->get<double>();
  if (!std::isfinite(v)) fail(expectation);
  return v;
}

double JsonCursor::positive(const char* expectation) const {
  const double v = number(expectation);
  if (!(v > 0.0)) fail(expectation);
  return v;
}

double JsonCursor::number_or_null(const char* expectation) const {
  if (value_->is_null()) return std::numeric_limits<double>::quiet_NaN();
  return number(expectation);
}

double JsonCursor::in_range(double low, double high, const char* expectation) const {
  const double v = number(expectation);
  if (!(v >= low && v <= high)) fail(expectation);
  return v;
}

int JsonCursor::integer(int low, int high, const char* expectation) const {
  if (!value_->is_number()) fail(expectation);
  const double v = value_->get<double>();
  if (!(v >= low && v <= high) || v != std::floor(v)) fail(expectation);
  return static_cast<int>(v);
}

bool JsonCursor::boolean() const {
  if (!value_->is_boolean()) fail("true or false");
  return value_->get<bool>();
}

const std::string& JsonCursor::text(const char* expectation) const {
  if (!value_->is_string()) fail(expectation);
  return value_->get_ref<const std::string&>();
}

std::filesystem::path JsonCursor::file_path() const {
  const std::string& name = text("a path");
  if (name.empty() || name.find('\0') != std::string::npos) fail("a path");
  return name;
}

std::vector<double> JsonCursor::numbers(std::size_t count, const char* expectation,
                                        bool nullable) const {
  if (!value_->is_array() || value_->size() != count) fail(expectation);
  std::vector<double> out;
  out.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const json& v = (*value_)[i];
    if (nullable && v.is_null()) {
      out.push_back(std::numeric_limits<double>::quiet_NaN());
    } else if (v.is_number()) {
      out.push_back(v.get<double>());
    } else {
      JsonCursor(v, *context_, path_ + "[" + std::to_string(i) + "]").fail("a number");
    }
  }
  return out;
}

Eigen::Vector3d JsonCursor::vector3(const char* expectation, bool nullable) const {
  const std::vector<double> v = numbers(3, expectation, nullable);
  return {v[0], v[1], v[2]};
}

Eigen::Vector3d JsonCursor::unit_vector() const {
  const Eigen::Vector3d v = vector3();
  const double length = v.stableNorm();
  if (!(std::abs(length - 1.0) <= kUnitTolerance)) {
    fail_because(fmt::format("found a vector of length {:.6g}, expected a unit vector (within {})",
                             length, kUnitTolerance));
  }
  // A vector that is unit to rounding stays as it is, so that writing and reading changes nothing.
  return std::abs(length - 1.0) <= 1e-12 ? v : Eigen::Vector3d(v / length);
}

Eigen::Matrix3d JsonCursor::rotation() const {
  const std::vector<double> v = numbers(9, "9 numbers, a rotation row by row");
  const Eigen::Matrix3d r =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
  const double error = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(error <= kUnitTolerance) || !(r.determinant() > 0.0)) {
    fail_because(fmt::format(
        "found a matrix that is no rotation ({}), expected 9 numbers, a "
        "rotation row by row",
        error <= kUnitTolerance ? "its determinant is -1"
                                : fmt::format("its columns are off orthonormal by {:.3g}", error)));
  }
  return r;
}

SE3 JsonCursor::pose() const {
  const char* expectation = "16 numbers, a rigid transform row by row";
  const std::vector<double> v = numbers(16, expectation);
  const Eigen::Matrix4d m =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(v.data());
  const Eigen::Matrix3d r = m.topLeftCorner<3, 3>();
  const double error = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(error <= kUnitTolerance) || !(r.determinant() > 0.0)) {
    fail_because(fmt::format("found a matrix whose 3 x 3 part is no rotation ({}), expected {}",
                             error <= kUnitTolerance
                                 ? "its determinant is -1"
                                 : fmt::format("its columns are off orthonormal by {:.3g}", error),
                             expectation));
  }
  if (m.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    fail_because(fmt::format("found the last row {} {} {} {}, expected 0 0 0 1", m(3, 0), m(3, 1),
                             m(3, 2), m(3, 3)));
  }
  return SE3::from_matrix(m);
}

std::vector<JsonCursor> JsonCursor::items(const char* expectation) const {
  if (!value_->is_array()) fail(expectation);
  std::vector<JsonCursor> out;
  out.reserve(value_->size());
  for (std::size_t i = 0; i < value_->size(); ++i) {
    out.emplace_back((*value_)[i], *context_, path_ + "[" + std::to_string(i) + "]");
  }
  return out;
}

JsonObject::JsonObject(const JsonCursor& cursor, const char* expectation) : cursor_(cursor) {
  if (!cursor.value().is_object()) cursor.fail(expectation);
}

std::string JsonObject::child_path(const std::string& key) const {
  return key_path(cursor_.path(), key);
}

std::optional<JsonCursor> JsonObject::find(const char* key) {
  known_.insert(key);
  const auto at = cursor_.value().find(key);
  if (at == cursor_.value().end() || at->is_null()) return std::nullopt;
  return JsonCursor(*at, cursor_.context(), child_path(key));
}

JsonCursor JsonObject::require(const char* key, const char* expectation) {
  known_.insert(key);
  const auto at = cursor_.value().find(key);
  if (at == cursor_.value().end()) {
    throw InputError(cursor_.context().file, child_path(key),
                     std::string("missing, expected ") + expectation);
  }
  JsonCursor child(*at, cursor_.context(), child_path(key));
  if (at->is_null()) child.fail(expectation);
  return child;
}

std::vector<std::pair<std::string, JsonCursor>> JsonObject::entries() {
  std::vector<std::pair<std::string, JsonCursor>> out;
  for (const auto& [key, value] : cursor_.value().items()) {
    known_.insert(key);
    out.emplace_back(key, JsonCursor(value, cursor_.context(), child_path(key)));
  }
  return out;
}

void JsonObject::note_unknown_keys() const {
  for (const auto& [key, value] : cursor_.value().items()) {
    if (known_.count(key)) continue;
    const std::string path = child_path(key);
    std::string pattern;
    bool inside = false;
    for (const char c : path) {
      if (c == ']') inside = false;
      if (!inside) pattern += c;
      if (c == '[') inside = true;
    }
    const auto [at, fresh] = cursor_.context().unknown.try_emplace(pattern, path, 0);
    if (!fresh) ++at->second.second;
  }
}

Plane read_plane(const JsonCursor& cursor, bool in_camera) {
  JsonObject object(cursor, "a plane {\"normal\": [x, y, z], \"offset\": metres}");
  const JsonCursor normal = object.require("normal", "a unit vector [x, y, z]");
  Plane plane;
  plane.normal = normal.unit_vector();
  // The same plane for a normal that was rounded: n and d are divided by the same length.
  const double length = normal.vector3().norm();
  plane.offset = object.require("offset", "a number of metres").number("a number of metres");
  if (std::abs(length - 1.0) > 1e-12) plane.offset /= length;
  if (in_camera && !(plane.normal.y() < 0.0)) {
    normal.fail_because(
        fmt::format("found a normal that points down (y = {:.4g}), expected it up, "
                    "out of the road: y < 0 in the camera frame",
                    plane.normal.y()));
  }
  object.note_unknown_keys();
  return plane;
}

nlohmann::json number_json(double value) {
  return std::isfinite(value) ? json(value) : json(nullptr);
}

nlohmann::json vector_json(const Eigen::Vector3d& v) {
  return json::array({number_json(v.x()), number_json(v.y()), number_json(v.z())});
}

nlohmann::json matrix_json(const Eigen::Matrix4d& m) {
  json out = json::array();
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) out.push_back(number_json(m(r, c)));
  }
  return out;
}

nlohmann::json matrix_json(const Eigen::Matrix3d& m) {
  json out = json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out.push_back(number_json(m(r, c)));
  }
  return out;
}

}  // namespace camber
