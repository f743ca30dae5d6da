#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace camber {

/// A small file of values by name: YAML (also as OpenCV writes it), JSON, or OpenCV's XML, whose
/// values have no positions.
class Document {
 public:
  /// @throws InputError if the file cannot be read, is larger than 64 MiB, or is none of these.
  static Document read(const std::filesystem::path& path);
  static Document parse(const std::string& text, const std::string& file);

  const std::string& file() const { return file_; }
  const YAML::Node& root() const { return root_; }

  /// @throws InputError "file: line L, column C: reason".
  [[noreturn]] void fail(const YAML::Node& at, const std::string& reason) const;
  /// "found (what stands there), expected (expectation)".
  [[noreturn]] void expected(const YAML::Node& at, const std::string& expectation) const;

  /// A finite number.
  double number(const YAML::Node& node, const std::string& expectation = "a number") const;
  int integer(const YAML::Node& node, int low, int high, const std::string& expectation) const;
  /// The numbers of a sequence, of a sequence of rows, or of an OpenCV or ROS matrix
  /// {rows, cols, data}. At most 1000.
  std::vector<double> numbers(const YAML::Node& node, const std::string& expectation) const;

 private:
  std::string file_;
  YAML::Node root_;
};

/// A name without case, '_', '-', '.' and blanks: "Camera_Matrix" is "cameramatrix".
std::string plain_name(const std::string& name);

/// The first value of a map whose plain name is one of those; in the order of the names.
std::optional<YAML::Node> find_by_plain_name(const YAML::Node& map,
                                             const std::vector<std::string>& names);

/// Text of a scalar without the quotes that some writers leave in it; else "".
std::string text_of(const YAML::Node& node);

}  // namespace camber
