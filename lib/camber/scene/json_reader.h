#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "camber/core/progress.h"
#include "camber/core/read_file.h"
#include "camber/geometry/plane.h"
#include "camber/geometry/se3.h"

namespace camber {

/// Parses JSON that may be damaged or hostile. Stricter than the standard parser: duplicate keys,
/// nesting deeper than 64 and numbers beyond the range of double are refused.
/// @throws InputError "file: line L, column C (byte B): found, expected".
nlohmann::json parse_json(const std::string& text, const std::string& file);

/// What the cursors of one document share.
struct JsonContext {
  std::string file;
  /// Places of unknown keys: by path without indices, the first full path and how many more.
  std::map<std::string, std::pair<std::string, int>> unknown;

  /// One sentence for each unknown key.
  void report_unknown(const LogSink& warn) const;
};

/// A value inside a JSON document that knows its path; every reading function checks and throws
/// InputError "file: JSON path: found ..., expected ...". The document and the context must outlive
/// it.
class JsonCursor {
 public:
  JsonCursor(const nlohmann::json& value, JsonContext& context, std::string path = {})
      : value_(&value), context_(&context), path_(std::move(path)) {}

  const nlohmann::json& value() const { return *value_; }
  JsonContext& context() const { return *context_; }
  const std::string& path() const { return path_; }

  /// Throws "found (what stands here), expected (expectation)".
  [[noreturn]] void fail(const std::string& expectation) const;
  /// Throws a free sentence at this place.
  [[noreturn]] void fail_because(const std::string& reason) const;
  /// What stands here, in words: "3 numbers", "null", "\"text\"".
  std::string describe() const;

  double number(const char* expectation = "a number") const;
  double positive(const char* expectation = "a positive number") const;
  /// A number or null (NaN).
  double number_or_null(const char* expectation = "a number or null") const;
  double in_range(double low, double high, const char* expectation) const;
  int integer(int low, int high, const char* expectation) const;
  bool boolean() const;
  const std::string& text(const char* expectation = "a string") const;
  /// A path: text, not empty, without a null byte.
  std::filesystem::path file_path() const;
  /// Exactly `count` numbers; with `nullable` a null reads as NaN.
  std::vector<double> numbers(std::size_t count, const char* expectation,
                              bool nullable = false) const;
  Eigen::Vector3d vector3(const char* expectation = "3 numbers [x, y, z]",
                          bool nullable = false) const;
  /// A unit vector within 0.001, made exactly unit.
  Eigen::Vector3d unit_vector() const;
  /// Nine numbers, row-major, orthonormal within 0.001, determinant 1.
  Eigen::Matrix3d rotation() const;
  /// Sixteen numbers, row-major: a rotation as above, a translation and the row 0 0 0 1.
  SE3 pose() const;
  std::vector<JsonCursor> items(const char* expectation) const;

 private:
  const nlohmann::json* value_;
  JsonContext* context_;
  std::string path_;
};

/// An object whose keys are taken one by one; what nobody took is unknown.
class JsonObject {
 public:
  explicit JsonObject(const JsonCursor& cursor, const char* expectation = "an object");

  /// The value of a key; nothing if it is absent or null.
  std::optional<JsonCursor> find(const char* key);
  /// @throws InputError "path.key: missing, expected (expectation)".
  JsonCursor require(const char* key, const char* expectation);
  /// All entries, marked as known.
  std::vector<std::pair<std::string, JsonCursor>> entries();
  /// Records the keys that were not taken. Call once after the last find.
  void note_unknown_keys() const;
  /// Whether a key was asked for.
  bool knows(const std::string& key) const { return known_.count(key) > 0; }
  const JsonCursor& cursor() const { return cursor_; }

 private:
  std::string child_path(const std::string& key) const;
  JsonCursor cursor_;
  std::set<std::string> known_;
};

/// {"normal": unit, "offset": m}; the normal must point up (y < 0) if `in_camera`.
Plane read_plane(const JsonCursor& cursor, bool in_camera);

/// JSON text indented by two spaces, with arrays of plain values on one line; ends in a newline.
/// Bytes that are no UTF-8 are replaced.
std::string format_json(const nlohmann::json& value);

/// Numbers that are not finite become null.
nlohmann::json number_json(double value);
nlohmann::json vector_json(const Eigen::Vector3d& v);
nlohmann::json matrix_json(const Eigen::Matrix4d& m);  ///< 16 numbers, row-major
nlohmann::json matrix_json(const Eigen::Matrix3d& m);  ///< 9 numbers, row-major

}  // namespace camber
