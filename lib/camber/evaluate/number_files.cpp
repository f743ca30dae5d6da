#include "camber/evaluate/number_files.h"

#include <Eigen/LU>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "camber/core/errors.h"

namespace camber {
namespace {

/// Numbers of a text file, blanks or commas between them, # to the end of a line ignored.
std::vector<double> read_numbers(const std::filesystem::path& path, std::size_t multiple,
                                 const std::string& expected) {
  std::ifstream in(path);
  if (!in) throw InputError(path.string(), "cannot be opened");
  std::vector<double> numbers;
  std::string line;
  for (std::size_t row = 1; std::getline(in, line); ++row) {
    line = line.substr(0, line.find('#'));
    for (char& c : line) {
      if (c == ',' || c == ';' || c == '\r') c = ' ';
    }
    std::istringstream words(line);
    std::string word;
    while (words >> word) {
      char* end = nullptr;
      const double value = std::strtod(word.c_str(), &end);
      if (*end != '\0' || !std::isfinite(value)) {
        throw InputError(path.string(), "line " + std::to_string(row),
                         "found '" + word.substr(0, 40) + "', expected a number");
      }
      numbers.push_back(value);
      if (numbers.size() > 6000000)
        throw InputError(path.string(), "more numbers than expected: " + expected);
    }
  }
  if (numbers.empty() || numbers.size() % multiple != 0) {
    throw InputError(path.string(),
                     "found " + std::to_string(numbers.size()) + " numbers, expected " + expected);
  }
  return numbers;
}

}  // namespace

Eigen::Matrix4d read_transform(const std::filesystem::path& path) {
  const std::vector<double> n = read_numbers(path, 4, "16, or 12 for three rows");
  if (n.size() != 16 && n.size() != 12) {
    throw InputError(path.string(), "found " + std::to_string(n.size()) +
                                        " numbers, expected 16, or 12 for three rows");
  }
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  for (std::size_t i = 0; i < n.size(); ++i) {
    m(static_cast<Eigen::Index>(i / 4), static_cast<Eigen::Index>(i % 4)) = n[i];
  }
  if ((m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-9 ||
      !(std::abs(m.topLeftCorner<3, 3>().determinant()) > 1e-12)) {
    throw InputError(path.string(),
                     "the numbers are no transform, expected an invertible matrix whose last "
                     "row is 0 0 0 1");
  }
  return m;
}

std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> read_point_pairs(
    const std::filesystem::path& path) {
  const std::vector<double> n = read_numbers(path, 6, "rows of 6");
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> out;
  for (std::size_t i = 0; i < n.size(); i += 6) {
    out.emplace_back(Eigen::Vector3d(n[i], n[i + 1], n[i + 2]),
                     Eigen::Vector3d(n[i + 3], n[i + 4], n[i + 5]));
  }
  return out;
}

}  // namespace camber
