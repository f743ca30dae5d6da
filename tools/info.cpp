// camber info: what a cloud, a scene manifest or a result folder holds.

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_summary.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/export/opendrive_reader.h"
#include "camber/import/formats/feather.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "cloud_arguments.h"
#include "cloud_description.h"
#include "command.h"
#include "crg_road.h"
#include "crs.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

Description describe_scene(const fs::path& path, const LogSink& warn) {
  const Scene scene = read_scene(path, warn);
  Description out;
  json& o = out.object;
  std::size_t vehicles = 0, keypoints = 0;
  json ids = json::array();
  std::string id_list;
  for (const SceneFrame& frame : scene.frames) {
    ids.push_back(frame.id);
    id_list += (id_list.empty() ? "" : " ") + std::to_string(frame.id);
    vehicles += frame.vehicles.size();
    for (const VehicleDetection& vehicle : frame.vehicles)
      keypoints += vehicle.keypoints.empty() ? 0 : 1;
  }
  o["file"] = path.string();
  o["kind"] = "scene";
  o["name"] = scene.name;
  o["frames"] = ids;
  o["camera"] = {{"width", scene.camera.width}, {"height", scene.camera.height},
                 {"fx", scene.camera.fx},       {"fy", scene.camera.fy},
                 {"cx", scene.camera.cx},       {"cy", scene.camera.cy}};
  o["height_above_road"] = scene.height_above_road ? json(*scene.height_above_road) : json(nullptr);
  o["metric"] = scene.height_above_road.has_value();
  o["vehicles"] = vehicles;
  o["vehicles_with_keypoints"] = keypoints;
  o["detections_source"] = scene.detections_source;
  o["truth"] = scene.truth.has_value();
  out.line("format", "scene manifest");
  out.line("name", scene.name);
  out.line("frames", fmt::format("{} ({})", scene.frames.size(), id_list));
  out.line("camera", fmt::format("{} x {} px, fx {:g} fy {:g} cx {:g} cy {:g}", scene.camera.width,
                                 scene.camera.height, scene.camera.fx, scene.camera.fy,
                                 scene.camera.cx, scene.camera.cy));
  out.line("height [m]", scene.height_above_road ? fmt::format("{:g}", *scene.height_above_road)
                                                 : "not known: results are up to scale");
  out.line("vehicles",
           fmt::format("{}, {} with keypoints{}", vehicles, keypoints,
                       scene.detections_source.empty() ? "" : ", from " + scene.detections_source));
  out.line("truth", scene.truth ? "yes" : "no");
  return out;
}

void describe_run(const RunDocument& run, const fs::path& path, const std::string& kind,
                  Description* out) {
  json& o = out->object;
  o["file"] = path.string();
  o["kind"] = kind;
  o["metric"] = run.metric;
  o["cameras"] = run.cameras.size();
  out->line("format", kind == "run" ? "run of a Camber result" : "Camber result");
  out->line("scale",
            run.metric ? fmt::format("metric, +- {:.2g} %", 100.0 * run.scale_sigma) : "unknown");
  out->line("cameras", std::to_string(run.cameras.size()));
  double total = 0.0;
  for (const auto& [stage, milliseconds] : run.timings.stages()) total += milliseconds;
  o["run_ms"] = number(total);
  out->line("run", fmt::format("{:.0f} ms", total));
}

Description describe_result(const fs::path& folder, const ReadOptions& options) {
  Description out;
  json& o = out.object;
  const fs::path road_of = road_folder(folder);
  describe_run(read_run(road_of / "run.json"), folder, "result", &out);
  if (fs::exists(road_of / "surface.json")) {
    const RoadSurface surface = read_surface(road_of / "surface.json");
    o["patches"] = surface.patches.size();
    out.line("patches", std::to_string(surface.patches.size()));
  }
  if (fs::exists(folder / "vehicles.json")) {
    const VehicleDocument vehicles = read_vehicles(folder / "vehicles.json");
    std::size_t count = 0;
    for (const VehicleFrame& frame : vehicles.frames) count += frame.vehicles.size();
    o["vehicles"] = count;
    o["method"] = vehicles.method;
    out.line("vehicles", fmt::format("{} in {} frames, method {}", count, vehicles.frames.size(),
                                     vehicles.method));
  }
  if (fs::exists(road_of / "road.ply")) {
    const fs::path cloud = road_of / "road.ply";
    const Description road =
        describe_cloud(cloud.string(), summarise(*open_point_source(cloud, options)));
    o["road"] = road.object;
    out.lines += "road.ply\n" + road.lines;
  }
  return out;
}

Description describe_crg(const fs::path& path) {
  const CrgData data = read_crg(path);
  const CrgRoad road(data, false);
  Description out;
  json& o = out.object;
  std::size_t unknown = 0;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < road.sections(); ++i) {
    for (std::size_t j = 0; j < data.v.size(); ++j) {
      const double z = road.node(i, j);
      if (std::isnan(z)) {
        ++unknown;
      } else {
        low = std::min(low, z);
        high = std::max(high, z);
      }
    }
  }
  std::string channels;
  for (const auto& [name, channel] :
       {std::pair("heading", &data.phi), {"banking", &data.banking}, {"slope", &data.slope}}) {
    if (!channel->empty()) channels += std::string(channels.empty() ? "" : ", ") + name;
  }
  o = {{"file", path.string()},
       {"kind", "opencrg"},
       {"encoding", to_string(data.encoding)},
       {"metric", true},
       {"sections", road.sections()},
       {"columns", data.v.size()},
       {"u", {road.first_u(), road.last_u()}},
       {"increment", data.increment},
       {"v", {data.v.front(), data.v.back()}},
       {"start", {data.start_x, data.start_y, data.start_z}},
       {"channels", channels},
       {"unknown", unknown},
       {"height", {number(low), number(high)}},
       {"modifiers", data.modifiers.has_value()},
       {"remarks", data.remarks}};
  json files = json::array();
  for (const fs::path& file : data.files) files.push_back(file.string());
  o["files"] = files;
  out.line("format", fmt::format("OpenCRG road, {}", to_string(data.encoding)));
  if (data.files.size() > 1) out.line("data in", data.files.back().string());
  out.line("u [m]", fmt::format("{:g} to {:g} in {} steps of {:g}", road.first_u(), road.last_u(),
                                road.sections() - 1, data.increment));
  out.line("v [m]", fmt::format("{:g} to {:g}, {} long sections", data.v.front(), data.v.back(),
                                data.v.size()));
  out.line("starts at [m]",
           fmt::format("{:.3f} {:.3f} {:.3f}", data.start_x, data.start_y, data.start_z));
  out.line("reference line", channels.empty() ? "straight and level" : channels);
  if (low <= high) out.line("heights [m]", fmt::format("{:.3f} to {:.3f}", low, high));
  out.line("unknown cells", fmt::format("{} of {}", unknown, data.heights.size()));
  for (const std::string& remark : data.remarks) out.line("remark", remark);
  return out;
}

const char* name_of(XodrPiece::Shape shape) {
  switch (shape) {
    case XodrPiece::Shape::kLine:
      return "line";
    case XodrPiece::Shape::kArc:
      return "arc";
    case XodrPiece::Shape::kSpiral:
      return "spiral";
    case XodrPiece::Shape::kPoly3:
      return "poly3";
    default:
      return "paramPoly3";
  }
}

/// Of every road, at most so many by themselves.
Description describe_xodr(const fs::path& path) {
  constexpr std::size_t kListed = 20;
  const XodrFile file = read_xodr(path);
  Description out;
  std::map<std::string, std::size_t> shapes, lanes;
  double length = 0.0;
  std::size_t elevations = 0, superelevations = 0, sections = 0, offsets = 0;
  json roads = json::array();
  for (const XodrRoad& road : file.roads) {
    length += road.length;
    elevations += road.elevation.size();
    superelevations += road.superelevation.size();
    sections += road.sections.size();
    offsets += road.lane_offset.size();
    for (const XodrPiece& piece : road.plan) ++shapes[name_of(piece.shape)];
    for (const XodrLaneSection& section : road.sections) {
      for (const auto* side : {&section.left, &section.right}) {
        for (const XodrLane& lane : *side) ++lanes[lane.type];
      }
    }
    roads.push_back({{"id", road.id}, {"name", road.name}, {"length", road.length}});
  }
  const auto text_or_null = [](const std::optional<std::string>& text) {
    return text ? json(*text) : json(nullptr);
  };
  out.object = {
      {"file", path.string()},
      {"kind", "opendrive"},
      {"rev", fmt::format("{}.{}", file.major, file.minor)},
      {"vendor", text_or_null(file.vendor)},
      {"name", text_or_null(file.name)},
      {"metric", true},
      {"total_length", length},
      {"junctions", file.junctions},
      {"geometries", shapes},
      {"elevation_records", elevations},
      {"superelevation_records", superelevations},
      {"lane_sections", sections},
      {"lane_offsets", offsets},
      {"lanes", lanes},
      {"geo_reference", file.geo_reference.empty() ? json(nullptr) : json(file.geo_reference)},
      {"roads", std::move(roads)}};
  std::string kinds;
  for (const auto& [name, count] : shapes) {
    kinds += fmt::format("{}{} {}", kinds.empty() ? "" : ", ", count, name);
  }
  out.line("format", fmt::format("OpenDRIVE {}.{}", file.major, file.minor));
  out.line("roads", fmt::format("{}, {:.3f} m in all, {} junctions", file.roads.size(), length,
                                file.junctions));
  out.line("plan view", kinds);
  out.line("elevation", fmt::format("{} records, superelevation {}", elevations, superelevations));
  out.line("lane sections", std::to_string(sections));
  out.line("coordinates", file.geo_reference.empty() ? "not stated" : file.geo_reference);
  for (std::size_t i = 0; i < std::min(kListed, file.roads.size()); ++i) {
    const XodrRoad& road = file.roads[i];
    out.line("road " + road.id, fmt::format("{:.3f} m {}", road.length, road.name));
  }
  return out;
}

Description describe_feather(const fs::path& path) {
  const FeatherTable table = read_feather(path);
  Description out;
  json columns = json::array();
  out.line("format", "Feather (Apache Arrow)");
  out.line("rows", std::to_string(table.rows));
  for (const FeatherColumn& column : table.columns) {
    columns.push_back({{"name", column.name}, {"type", column.type}});
    out.line(column.name, column.type);
  }
  out.object = {{"file", path.string()},
                {"kind", "feather"},
                {"rows", table.rows},
                {"columns", std::move(columns)}};
  return out;
}

std::size_t count_vehicles(const VehicleDocument& document) {
  std::size_t count = 0;
  for (const VehicleFrame& frame : document.frames) count += frame.vehicles.size();
  return count;
}

Description describe_vehicles(const fs::path& path) {
  const VehicleDocument document = read_vehicles(path);
  const std::size_t count = count_vehicles(document);
  Description out;
  out.object = {{"file", path.string()},
                {"kind", "vehicles"},
                {"metric", document.metric},
                {"method", document.method},
                {"preset", document.preset},
                {"detections_source", document.detections_source},
                {"frames", document.frames.size()},
                {"vehicles", count}};
  out.line("format", "vehicles of a Camber result");
  out.line("scale", document.metric ? "metric" : "unknown");
  out.line("vehicles", fmt::format("{} in {} frames, method {}", count, document.frames.size(),
                                   document.method));
  if (!document.detections_source.empty()) out.line("detections", document.detections_source);
  return out;
}

Description describe_surface(const fs::path& path) {
  const RoadSurface surface = read_surface(path);
  Description out;
  out.object = {{"file", path.string()},
                {"kind", "surface"},
                {"metric", surface.metric},
                {"frame", surface.frame},
                {"level", to_string(surface.level)},
                {"patches", surface.patches.size()},
                {"links", surface.links.size()},
                {"driven_line", surface.driven_line.size()}};
  out.line("format", "surface of a Camber result");
  out.line("scale", surface.metric ? "metric" : "unknown");
  out.line("frame", fmt::format("{}, level: {}", surface.frame, to_string(surface.level)));
  out.line("patches", fmt::format("{}, {} links", surface.patches.size(), surface.links.size()));
  out.line("driven line", fmt::format("{} points", surface.driven_line.size()));
  return out;
}

/// @param document  of metrics.json
Description describe_metrics(const fs::path& path, const json& document) {
  Description out;
  json& o = out.object;
  o = {{"file", path.string()}, {"kind", "metrics"}};
  const auto take = [&](const char* key) {
    const auto found = document.find(key);
    const bool good = found != document.end() && (found->is_number() || found->is_null());
    if (!good) {
      throw InputError(path.string(), fmt::format("$.{}", key),
                       fmt::format("found {}, expected a number or null",
                                   found == document.end() ? "nothing" : found->type_name()));
    }
    o[key] = *found;
    return found->is_number() ? found->get<double>() : std::nan("");
  };
  const double counted = take("counted"), matched = take("matched"), missed = take("missed"),
               unanswered = take("unanswered"), scale = take("scale_error"),
               rotation = take("rotation_error_deg"), direction = take("direction_error_deg"),
               height = take("ego_height_error"), normal = take("ego_normal_error_deg"),
               within = take("center_within_95");
  out.line("format", "metrics of a Camber result against the truth");
  if (std::isfinite(scale)) out.line("scale error", fmt::format("{:+.2f} %", 100.0 * scale));
  if (std::isfinite(direction)) {
    out.line("motion",
             fmt::format("direction {:.3f} deg, rotation {:.3f} deg", direction, rotation));
  }
  if (std::isfinite(height)) {
    out.line("ego plane", fmt::format("height {:+.3f} m, normal {:.2f} deg", height, normal));
  }
  out.line("vehicles", fmt::format("{:.0f} counted, {:.0f} found, {:.0f} missed, {:.0f} without "
                                   "an answer",
                                   counted, matched, missed, unanswered));
  if (std::isfinite(within)) {
    out.line("centres", fmt::format("{:.0f} % within their 95 % ellipsoids", 100.0 * within));
  }
  return out;
}

Description describe_run(const fs::path& path) {
  Description out;
  describe_run(read_run(path), path, "run", &out);
  return out;
}

/// A JSON file of a result by its keys; else a scene, whose reader names what is missing.
Description describe_json(const fs::path& path, const LogSink& warn) {
  std::ifstream in(path);
  const json document = json::parse(in, nullptr, false);
  const auto has = [&](const char* key) { return document.is_object() && document.contains(key); };
  if (has("format")) return describe_scene(path, warn);
  if (has("patches")) return describe_surface(path);
  if (has("frames") && has("method")) return describe_vehicles(path);
  if (has("timings_ms") && has("cameras") && has("inputs")) return describe_run(path);
  if (has("counted") && has("by_distance")) return describe_metrics(path, document);
  return describe_scene(path, warn);
}

bool looks_like_json(const fs::path& path) {
  if (path.extension() == ".json") return true;
  std::ifstream in(path, std::ios::binary);
  char c = 0;
  while (in.get(c) && (c == ' ' || c == '\n' || c == '\r' || c == '\t')) {
  }
  return in && c == '{';
}

/// @param in_full  with what JSON alone has
Description describe(const std::string& name, const ReadOptions& options, bool in_full,
                     const LogSink& warn) {
  const fs::path path = name;
  std::error_code error;
  if (fs::is_directory(path, error)) {
    // camber synth leaves its run.json beside the scene that it makes.
    const bool scene = fs::exists(path / "scene.json", error) &&
                       !fs::exists(path / "surface.json", error) &&
                       !fs::exists(path / "vehicles.json", error);
    if (!scene && fs::exists(path / "run.json", error)) return describe_result(path, options);
    if (!fs::exists(path / "points3D.bin", error) && !fs::exists(path / "points3D.txt", error)) {
      return describe_scene(path, warn);
    }
  }
  if (is_crg(path)) return describe_crg(path);
  if (is_xodr(path)) return describe_xodr(path);
  if (is_feather(path)) return describe_feather(path);
  if (fs::is_regular_file(path, error) && looks_like_json(path)) return describe_json(path, warn);
  CloudSummary summary = summarise(*open_point_source(path, options));
  if (summary.crs) {
    complete_crs(&*summary.crs);
    summary.metric = summary.metric && summary.crs->metric();
  }
  Description out = describe_cloud(name, summary);
  if (in_full && summary.crs && summary.crs->wkt.empty()) {
    const std::string wkt = wkt_of_codes(*summary.crs);
    if (!wkt.empty()) {
      out.object["crs"]["wkt"] = wkt;
      out.object["crs"]["wkt_source"] = "epsg";
    }
  }
  return out;
}

}  // namespace

void register_info(App& root) {
  Command* command =
      add_command(root, "info",
                  "Shows what clouds, OpenCRG and OpenDRIVE roads, COLMAP models, Feather "
                  "tables, scene manifests and result folders hold",
                  "  camber info road.ply\n"
                  "  camber info scan.pcd points.bin --json\n"
                  "  camber info damaged.pcd --lenient\n"
                  "  camber info points.txt --columns x,y,z,_,intensity\n"
                  "  camber info results");
  struct Arguments {
    std::vector<std::string> files;
    CloudArguments cloud;
    bool as_json = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  App& app = *command->app;
  app.add_option(
         "files", arguments->files,
         "clouds, .crg, .xodr, .feather, scene manifests, result folders or their .json files")
      ->required();
  add_cloud_arguments(app, arguments->cloud);
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");

  command->run = [command, arguments] {
    const ReadOptions options = arguments->cloud.read_options();
    const LogSink warn = make_warning_sink(command->common);
    json files = json::array();
    Timings timings;
    StageTimer load(timings, "load");
    for (const std::string& name : arguments->files) {
      throw_if_interrupted();
      const Description printed = describe(name, options, arguments->as_json, warn);
      if (arguments->as_json) {
        files.push_back(printed.object);
      } else {
        fmt::print("{}\n{}", name, printed.lines);
      }
    }
    load.stop();
    if (arguments->as_json) {
      const json out = {
          {"version", kVersion},
          {"seed", command->common.seed},
          {"options", {{"lenient", options.lenient}, {"columns", options.columns}}},
          {"timings_ms",
           {{"load", timings.stages().front().second}, {"compute", 0.0}, {"write", 0.0}}},
          {"files", files}};
      fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
    }
    return 0;
  };
}

}  // namespace camber::tools
