#include "strip_input.h"

#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber::tools {

bool is_strip(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / "index.json", error) && !fs::exists(folder / "run.json", error);
}

StripIndex read_strip_index(const fs::path& folder) {
  const fs::path file = folder / "index.json";
  const nlohmann::json document = parse_json(read_whole_file(file), file.string());
  JsonContext context{file.string(), {}};
  JsonObject index{JsonCursor(document, context)};
  const JsonCursor format = index.require("format", "\"camber-strip\"");
  if (format.text() != "camber-strip") format.fail("\"camber-strip\"");
  StripIndex out;
  out.metric = index.require("metric", "true or false").boolean();
  out.level = index.require("level", "\"gravity\" or \"camera\"").text();
  out.strip_from_world = index.require("strip_from_world", "16 numbers").pose();
  if (const auto cell = index.find("cell")) out.cell = cell->positive();
  const JsonCursor line = index.require("driven_line_s_xyz", "a list of places");
  for (const JsonCursor& item : line.items("a list of places")) {
    const std::vector<double> numbers = item.numbers(4, "4 numbers [s, x, y, z]");
    out.line.emplace_back(numbers[1], numbers[2], numbers[3]);
  }
  for (const JsonCursor& item : index.require("stretches", "a list").items("stretches")) {
    JsonObject at{item};
    StripIndex::Stretch stretch;
    stretch.file = folder / at.require("file", "a file name").file_path().filename();
    stretch.from_s = at.require("from_s", "metres").number();
    out.stretches.push_back(std::move(stretch));
  }
  return out;
}

RoadCloud read_strip_cells(const StripIndex& index) {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  out.metric = index.metric;
  for (const StripIndex::Stretch& stretch : index.stretches) {
    const RoadCloud cells = read_cloud(stretch.file);
    if (cells.empty()) continue;
    if (out.empty()) out.origin = cells.origin;
    const auto labels = cells.labels.find("label");
    if (cells.sigmas.empty() || labels == cells.labels.end()) {
      throw InputError(stretch.file.string(), "found cells without sigma or label, expected both");
    }
    for (const Eigen::Vector3f& p : cells.points) {
      out.points.push_back((cells.origin - out.origin + p.cast<double>()).cast<float>());
    }
    out.sigmas.insert(out.sigmas.end(), cells.sigmas.begin(), cells.sigmas.end());
    std::vector<int>& all = out.labels["label"];
    all.insert(all.end(), labels->second.begin(), labels->second.end());
  }
  return out;
}

RoadStrip read_strip(const StripIndex& index) {
  RoadStrip out;
  out.strip_from_world = index.strip_from_world;
  out.line = DrivenLine(index.line);
  for (const StripIndex::Stretch& stretch : index.stretches) {
    const RoadCloud cells = read_cloud(stretch.file);
    if (cells.empty()) continue;
    const auto s = cells.scalars.find("s"), lateral = cells.scalars.find("lateral");
    if (cells.sigmas.empty() || s == cells.scalars.end() || lateral == cells.scalars.end()) {
      throw InputError(stretch.file.string(),
                       "found cells without s, lateral or sigma, expected all of them");
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      StripCell cell;
      cell.s = s->second[i];
      cell.lateral = lateral->second[i];
      cell.point = cells.origin + cells.points[i].cast<double>();
      cell.sigma = cells.sigmas[i];
      out.cells.push_back(cell);
    }
  }
  return out;
}

}  // namespace camber::tools
