#include "crg_road.h"

#include <fmt/format.h>

#include <cmath>

#include "camber/cloud/file_reader.h"
#include "camber/cloud/number_text.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"

namespace camber::tools {
namespace {

std::vector<std::string> cells(std::string_view line) {
  std::string text(line);
  for (char& c : text) {
    if (c == ',' || c == ';' || c == '"') c = ' ';
  }
  std::vector<std::string> out;
  std::string_view rest = text;
  while (true) {
    const std::string_view word = next_word(rest);
    if (word.empty()) return out;
    out.push_back(lower_case(word));
  }
}

bool number(const std::string& text, double* value) {
  const ParsedNumber parsed = parse_number(text.data(), text.data() + text.size());
  *value = parsed.value;
  return parsed.end == text.data() + text.size() && std::isfinite(parsed.value);
}

int column(const std::vector<std::string>& names, const std::string& name) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i] == name || names[i] == name + "_m" || names[i] == name + "[m]") {
      return static_cast<int>(i);
    }
  }
  return -1;
}

}  // namespace

bool is_crg(const std::filesystem::path& path) {
  return lower_case(path.extension().string()) == ".crg";
}

bool is_xodr(const std::filesystem::path& path) {
  return lower_case(path.extension().string()) == ".xodr";
}

bool is_filled(const CrgRoad& road, const CrgRoad& stored, const Eigen::Vector2d& uv) {
  // The same place of the grid before any modifier scaled it.
  const double u =
      stored.first_u() + (uv.x() - road.first_u()) / road.increment() * stored.increment();
  const double width = (road.left() - road.right()) / (stored.left() - stored.right());
  return std::isnan(stored.height(u, uv.y() / width));
}

RoadCloud crg_points(const CrgRoad& road, const CrgRoad& stored) {
  constexpr double kSpacing = 0.25;  // m
  const auto steps = [&](double length) {
    return std::max<long>(1, std::lround(std::ceil(length / kSpacing - 1e-9)));
  };
  const double length = road.last_u() - road.first_u(), width = road.left() - road.right();
  const long along = steps(length), across = steps(width);
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  for (long i = 0; i <= along; ++i) {
    const double u = road.first_u() + length * static_cast<double>(i) / static_cast<double>(along);
    for (long k = 0; k <= across; ++k) {
      const double v = road.right() + width * static_cast<double>(k) / static_cast<double>(across);
      const double z = road.height(u, v);
      if (!std::isfinite(z) || is_filled(road, stored, {u, v})) continue;
      const Eigen::Vector2d xy = road.position(u, v);
      const Eigen::Vector3d point(xy.x(), xy.y(), z);
      if (out.points.empty()) out.origin = point.array().round();
      out.points.push_back((point - out.origin).cast<float>());
    }
  }
  return out;
}

std::vector<Eigen::Vector3d> crg_line(const CrgRoad& road) {
  std::vector<Eigen::Vector3d> out;
  const double length = road.last_u() - road.first_u();
  const auto count = static_cast<long>(std::floor(length - 1e-6));
  for (long i = 0; i <= count + 1; ++i) {
    const double u = i <= count ? road.first_u() + static_cast<double>(i) : road.last_u();
    const Eigen::Vector2d xy = road.position(u, 0.0);
    out.emplace_back(xy.x(), xy.y(), 0.0);
  }
  return out;
}

CrgPlaces read_crg_places(const std::string& path) {
  FileReader file(path);
  LineReader lines(file);
  CrgPlaces out;
  int first = -1, second = -1;
  std::string_view line;
  while (lines.next(line, 1 << 16)) {
    std::vector<std::string> row = cells(line);
    if (row.empty()) continue;
    if (row.front().front() == '#') {
      row.front().erase(0, 1);
      if (row.front().empty()) row.erase(row.begin());
      if (first >= 0 || (column(row, "u") < 0 && column(row, "x") < 0)) continue;
    }
    double a = 0.0, b = 0.0;
    if (first < 0) {
      if (!number(row.front(), &a)) {
        out.by_uv = column(row, "u") >= 0;
        first = column(row, out.by_uv ? "u" : "x");
        second = column(row, out.by_uv ? "v" : "y");
        if (first < 0 || second < 0) lines.fail("expected columns u and v, or x and y");
        continue;
      }
      if (row.size() < 2) lines.fail("found 1 column, expected u and v, or x, y and z");
      out.by_uv = row.size() == 2;
      first = 0, second = 1;
    }
    const auto most = static_cast<std::size_t>(std::max(first, second));
    if (row.size() <= most) {
      lines.fail(fmt::format("found {} columns, expected at least {}", row.size(), most + 1));
    }
    for (const auto& [index, value] : {std::pair(first, &a), std::pair(second, &b)}) {
      const std::string& text = row[static_cast<std::size_t>(index)];
      if (!number(text, value)) lines.fail("found " + shown(text) + ", expected a number");
    }
    out.places.emplace_back(a, b);
  }
  if (out.places.empty())
    throw InputError(path, "found no places, expected rows of u and v or x, y");
  return out;
}

}  // namespace camber::tools
