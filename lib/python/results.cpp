// render, report and export of results and clouds.

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/export/crg_strip.h"
#include "camber/export/opencrg.h"
#include "camber/export/opendrive.h"
#include "camber/export/result_vehicles.h"
#include "camber/export/road_mesh.h"
#include "camber/export/road_raster.h"
#include "camber/export/road_to_export.h"
#include "camber/image/image_io.h"
#include "camber/import/maps/proj_systems.h"
#include "camber/render/frame_overlay.h"
#include "camber/render/loaded_result.h"
#include "camber/render/picture_switches.h"
#include "camber/render/pictures.h"
#include "camber/render/report.h"
#include "camber/road/surface_lookup.h"
#include "camber/scene/results.h"
#include "convert.h"
#include "maps.h"
#include "reconstruction.h"
#include "running.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

using Parts = std::vector<std::string>;

bool is_path(const py::object& value) {
  return py::isinstance<py::str>(value) || py::hasattr(value, "__fspath__");
}

/// A result of reconstruct(), a cloud, or what lies under a path.
LoadedResult result_of(const py::object& value, const char* name) {
  if (is_path(value)) return load_result(value.cast<fs::path>());
  LoadedResult out;
  if (py::isinstance<PythonReconstruction>(value)) {
    const auto& result = value.cast<const PythonReconstruction&>();
    out.cloud = result.cloud;
    out.surface = result.surface;
    out.vehicles = result.vehicles;
    out.run = result.run;
    out.scene = result.of;
    return out;
  }
  if (py::isinstance<RoadSurface>(value)) {
    out.surface = value.cast<RoadSurface>();
    return out;
  }
  out.cloud = *CloudArgument(value, name).cloud;
  return out;
}

/// The scene that the result's run read, if it is there, else the picture goes without.
void add_scene(const std::optional<fs::path>& scene, LoadedResult* result) {
  if (scene) {
    result->scene = read_scene(*scene, python_warnings());
  } else if (!result->scene) {
    result->load_scene_of_run();
  }
}

struct Look {
  std::string view, color, title;
  std::pair<int, int> size;
  Parts show, hide;
  std::optional<int> frame;
  std::optional<Eigen::Vector3d> up;
  std::optional<std::vector<double>> camera;
  double azimuth, elevation, point_size, upscale;
  int supersampling;
  bool transparent;
};

SceneView scene_view(const std::string& name) {
  if (name == "both") return SceneView::kObliqueAndSide;
  if (name == "oblique") return SceneView::kOblique;
  if (name == "side") return SceneView::kSide;
  if (name == "driver") return SceneView::kDriver;
  throw std::invalid_argument("view: found '" + name +
                              "', expected 'both', 'oblique', 'side', 'driver', 'bev' or "
                              "'overlay'");
}

PictureContent content_of(const LoadedResult& result, const Look& look) {
  PictureContent content = result.content();
  if (look.frame) content.frame = *look.frame;
  if (look.up) content.up = look.up;
  content.title = look.title;
  if (content.title.empty() && result.scene) content.title = result.scene->name;
  if (content.title.empty()) content.title = result.path.filename().string();
  return content;
}

Image draw(const LoadedResult& result, const Look& look) {
  const PictureContent content = content_of(result, look);
  if (look.view == "overlay") {
    OverlayOptions options;
    options.upscale = look.upscale;
    switch_parts(overlay_switches(), look.show, look.hide, look.view, &options);
    return draw_frame_overlay(result, content.frame, options);
  }
  if (look.view == "bev") {
    BevPictureOptions options;
    options.width = look.size.first;
    options.height = look.size.second;
    options.point_size = look.point_size;
    options.color = PointColor::parse(look.color);
    switch_parts(bev_switches(), look.show, look.hide, look.view, &options);
    return render_bev_picture(content, options);
  }
  ScenePictureOptions options;
  options.width = look.size.first;
  options.height = look.size.second;
  options.supersampling = look.supersampling;
  options.view = scene_view(look.view);
  options.point_size = look.point_size;
  options.azimuth = look.azimuth;
  options.elevation = look.elevation;
  options.color = PointColor::parse(look.color);
  options.transparent = look.transparent;
  switch_parts(scene_switches(), look.show, look.hide, look.view, &options);
  if (look.camera) {
    const std::vector<double>& c = *look.camera;
    if (c.size() != 10) {
      throw std::invalid_argument(fmt::format(
          "camera: found {} numbers, expected 10: eye, target, up, field of view", c.size()));
    }
    options.view = SceneView::kFree;
    options.free_view = {{c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]}, c[9]};
  }
  return render_scene_picture(content, options);
}

py::array to_array(const Image& image) {
  std::vector<py::ssize_t> shape = {image.height, image.width};
  if (image.channels > 1) shape.push_back(image.channels);
  return py::array_t<std::uint8_t>(shape, image.data.data());
}

void bind_render(py::module_& module) {
  const ScenePictureOptions defaults;
  module.def(
      "render",
      [](const py::object& result, const std::optional<fs::path>& out, const std::string& view,
         const std::string& color, std::pair<int, int> size, const Parts& show, const Parts& hide,
         std::optional<int> frame, const std::optional<Eigen::Vector3d>& up,
         const std::optional<std::vector<double>>& camera, double azimuth, double elevation,
         double point_size, int supersampling, bool transparent, double upscale,
         const std::optional<fs::path>& scene, const py::object& truth_cloud,
         const std::string& title) {
        LoadedResult loaded = result_of(result, "result");
        if (!truth_cloud.is_none()) {
          loaded.truth_cloud = is_path(truth_cloud)
                                   ? read_cloud(truth_cloud.cast<fs::path>())
                                   : *CloudArgument(truth_cloud, "truth_cloud").cloud;
        }
        const Look look = {view,      color,      title,   size,          show,
                           hide,      frame,      up,      camera,        azimuth,
                           elevation, point_size, upscale, supersampling, transparent};
        const Image picture = compute([&] {
          add_scene(scene, &loaded);
          Image drawn = draw(loaded, look);
          if (out) write_png(drawn, *out);
          return drawn;
        });
        return to_array(picture);
      },
      py::arg("result"), py::arg("out") = py::none(), py::kw_only(), py::arg("view") = "both",
      py::arg("color") = "height", py::arg("size") = std::pair(defaults.width, defaults.height),
      py::arg("show") = Parts(), py::arg("hide") = Parts(), py::arg("frame") = py::none(),
      py::arg("up") = py::none(), py::arg("camera") = py::none(),
      py::arg("azimuth") = defaults.azimuth, py::arg("elevation") = defaults.elevation,
      py::arg("point_size") = defaults.point_size,
      py::arg("supersampling") = defaults.supersampling,
      py::arg("transparent") = defaults.transparent, py::arg("upscale") = 1.0,
      py::arg("scene") = py::none(), py::arg("truth_cloud") = py::none(), py::arg("title") = "",
      with_keywords(
          "A picture, height x width x 3 (4 where transparent), without a display.",
          {{"result",
            "a result of reconstruct(), a cloud or surface, or the path of a result "
            "folder, a cloud or a vehicles.json"},
           {"out", "PNG file to write, too"},
           {"view", "'both' (oblique over side), 'oblique', 'side', 'driver', 'bev', 'overlay'"},
           {"color", "of points: 'height', 'sigma', 'patch', 'image', 'error' or an attribute"},
           {"size", "width and height, px"},
           {"show", "parts to draw besides the usual ones, as camber render --help lists them"},
           {"hide", "parts to leave out"},
           {"frame", "id of the frame whose vehicles are shown; None: the reference"},
           {"camera",
            "a free view: eye, target and up, 3 numbers each, and the vertical field of "
            "view, rad"},
           {"azimuth", "rad, of the oblique view's direction, from ahead to the right"},
           {"elevation", "rad, of the oblique view's eye above the content"},
           {"point_size", "px; 0: from the number of points"},
           {"supersampling", "drawn so many times larger and averaged, 1 to 4"},
           {"transparent", "3D views: an alpha channel instead of white ground"},
           {"upscale", "of 'overlay': the image is enlarged so many times"},
           {"scene", "manifest: camera, images and truth; None: that of the run, if it is there"},
           {"truth_cloud", "dense ground truth in the result's frame: a cloud, or its file"}})
          .c_str());
  module.def(
      "report",
      [](const fs::path& result, const fs::path& out, const std::optional<fs::path>& scene) {
        compute([&] {
          LoadedResult loaded = load_result(result);
          add_scene(scene, &loaded);
          Look look{};
          write_report(report_of_result(content_of(loaded, look), result), out);
        });
      },
      py::arg("result"), py::arg("out"), py::kw_only(), py::arg("scene") = py::none(),
      with_keywords("Writes one HTML page to read of a result folder.",
                    {{"result", "result folder of reconstruct"}, {"out", "FILE.html"}})
          .c_str());
}

struct ExportKeywords {
  std::string to, encoding, crg, crs;
  double step, step_across, left, right, widest, smoothing, ahead, reach;
  std::optional<double> tolerance;
  bool vehicles;
  int threads;
};

py::dict written_crg(const RoadToExport& road, const SmoothLine& line, const ExportKeywords& k,
                     const fs::path& out) {
  CrgGridOptions options;
  options.step_u = k.step > 0.0 ? k.step : road.step;
  options.step_v = k.step_across > 0.0 ? k.step_across : road.step;
  options.left = k.left;
  options.right = k.right;
  options.widest = k.widest;
  options.smoothing = k.smoothing;
  options.num_threads = k.threads;
  if (k.encoding == "binary") options.encoding = CrgEncoding::kBinary;
  options.validate();
  CrgData data = compute([&] { return make_crg(*road.ground, line, options); });
  data.comment = described(road);
  write_crg(data, out);
  py::dict done;
  done["sections"] = data.sections();
  done["columns"] = data.v.size();
  done["increment"] = data.increment;
  return done;
}

py::dict written_opendrive(const RoadToExport& road, const SmoothLine& line,
                           const ExportKeywords& k, const fs::path& out, const fs::path& folder) {
  OpenDriveOptions options;
  options.name = out.stem().string();
  options.left = k.left;
  options.right = k.right;
  options.widest = k.widest;
  if (!find_proj_string(road.geo_reference, &options.geo_reference)) {
    options.geo_reference = proj_string_of(road.geo_reference);
  }
  options.crg_file = k.crg;
  options.num_threads = k.threads;
  if (k.vehicles) options.vehicles = result_vehicles(folder, road.frame).vehicles;
  options.validate();
  const OpenDriveRoad made = compute([&] { return make_opendrive(*road.ground, line, options); });
  write_file_atomically(out, encode_opendrive(made));
  py::dict done;
  done["pieces"] = made.plan.size();
  done["vehicles"] = made.vehicles.size();
  done["height_rms"] = made.height_rms;
  return done;
}

py::dict written_mesh(const RoadToExport& road, const SmoothLine& line, const ExportKeywords& k,
                      const fs::path& out, const RoadCloud* colored, const PlanCorridor& where) {
  RoadMeshOptions options;
  options.left = k.left;
  options.right = k.right;
  options.widest = k.widest;
  options.num_threads = k.threads;
  options.step = k.step > 0.0 ? k.step : road.step;
  options.validate();
  std::optional<ColorSource> colors;
  if (colored && !colored->colors.empty()) colors.emplace(*colored, road.frame, &where);
  const RoadMesh mesh = compute(
      [&] { return make_road_mesh(*road.ground, line, colors ? &*colors : nullptr, options); });
  const std::string kind = out.extension().string();
  write_file_atomically(out, kind == ".glb"   ? encode_glb(mesh)
                             : kind == ".obj" ? encode_obj(mesh)
                                              : encode_ply(mesh));
  py::dict done;
  done["points"] = mesh.points.size();
  done["triangles"] = mesh.triangles.size();
  return done;
}

py::dict written_geotiff(const RoadToExport& road, const SmoothLine& line, const ExportKeywords& k,
                         const fs::path& out, const RoadCloud* colored, const PlanCorridor& where) {
  const py::object encode = gdal_function("encode_geotiff");
  RoadRasterOptions options;
  options.cell = k.step;
  options.left = k.left;
  options.right = k.right;
  options.widest = k.widest;
  options.num_threads = k.threads;
  options.validate();
  std::optional<ColorSource> colors;
  if (colored && !colored->colors.empty()) colors.emplace(*colored, road.frame, &where);
  RoadRaster raster = compute(
      [&] { return make_road_raster(*road.ground, line, colors ? &*colors : nullptr, options); });
  const std::vector<py::ssize_t> shape = {static_cast<py::ssize_t>(raster.rows),
                                          static_cast<py::ssize_t>(raster.columns)};
  const auto band = [&](const std::vector<float>& values) {
    return py::array_t<float>(shape, values.data());
  };
  py::object colors_array = py::none();
  if (!raster.colors.empty()) {
    // Red, green, blue, and whether they are known.
    py::array_t<std::uint8_t> made({shape[0], shape[1], py::ssize_t{4}});
    std::uint8_t* at = made.mutable_data();
    for (const auto& color : raster.colors) {
      for (std::size_t i = 0; i < 3; ++i) *at++ = color ? (*color)[i] : std::uint8_t{0};
      *at++ = color ? 255 : 0;
    }
    colors_array = std::move(made);
  }
  py::dict metadata;
  metadata["TIFFTAG_SOFTWARE"] = std::string("Camber ") + kVersion;
  metadata["TIFFTAG_IMAGEDESCRIPTION"] = road.described;
  metadata["CAMBER_LEVEL"] = road.level;
  const py::bytes bytes =
      encode(band(raster.heights), band(raster.sigmas), band(raster.slopes), colors_array,
             raster.west, raster.north, raster.cell, road.geo_reference, metadata);
  write_file_atomically(out, std::string(bytes));
  py::dict done;
  done["columns"] = raster.columns;
  done["rows"] = raster.rows;
  done["cell"] = raster.cell;
  done["west"] = raster.west;
  done["north"] = raster.north;
  return done;
}

/// N x 3 numbers, or the points of a file.
std::vector<Eigen::Vector3d> line_of(const py::object& along) {
  if (!is_path(along)) return to_points(along, "along");
  const RoadCloud cloud = read_cloud(along.cast<fs::path>());
  std::vector<Eigen::Vector3d> out;
  for (const Eigen::Vector3f& p : cloud.points) out.push_back(cloud.origin + p.cast<double>());
  return out;
}

py::dict exported(const py::object& source, const fs::path& out, const py::object& along,
                  const ExportKeywords& k) {
  if (k.to != "opencrg" && k.to != "opendrive" && k.to != "mesh" && k.to != "geotiff") {
    throw std::invalid_argument("to: found '" + k.to +
                                "', expected 'opencrg', 'opendrive', 'mesh' or 'geotiff'");
  }
  if (k.encoding != "text" && k.encoding != "binary") {
    throw std::invalid_argument("encoding: found '" + k.encoding +
                                "', expected 'text' or 'binary'");
  }
  const std::string kind = out.extension().string();
  if (k.to == "mesh" && kind != ".glb" && kind != ".obj" && kind != ".ply") {
    throw std::invalid_argument("out: expected FILE.glb, FILE.obj or FILE.ply");
  }
  RoadExtent extent;
  extent.ahead = k.ahead;
  extent.left = k.left;
  extent.right = k.right;
  extent.widest = k.widest;
  extent.tolerance = k.tolerance.value_or(extent.tolerance);
  RoadToExport road;
  std::optional<RoadCloud> cloud;
  fs::path folder;
  const std::vector<Eigen::Vector3d> line =
      along.is_none() ? std::vector<Eigen::Vector3d>() : line_of(along);
  std::error_code ignored;
  const bool result = is_path(source) && (fs::is_directory(source.cast<fs::path>(), ignored) ||
                                          source.cast<fs::path>().extension() == ".json");
  if (result) {
    fs::path file = source.cast<fs::path>();
    folder = fs::is_directory(file, ignored) ? file : file.parent_path();
    if (fs::is_directory(file, ignored)) file = road_folder(file) / "surface.json";
    RoadSurface surface = read_surface(file);
    if (!line.empty()) take_as_road(line, k.reach, &surface);
    road = compute([&] {
      return road_of_surface(file, surface, line.empty() ? surface.driven_line : line, k.reach);
    });
    const fs::path held = cloud_of_result(file);
    if (!held.empty()) cloud = read_cloud(held);
  } else {
    if (line.size() < 2) throw std::invalid_argument("along: expected the places of a line");
    cloud = is_path(source) ? read_cloud(source.cast<fs::path>())
                            : *CloudArgument(source, "source").cloud;
    if (!cloud->metric) throw NoAnswerError("the cloud is not in metres");
    road = compute([&] { return road_of_cloud(*cloud, cloud->default_up(), line, true, extent); });
  }
  if (!k.crs.empty()) {
    if (!road.geo_reference.empty()) {
      throw std::invalid_argument("crs: found a source that states its coordinate system");
    }
    road.geo_reference = map_definition(k.crs, "crs");
  }
  const double tolerance = k.tolerance ? *k.tolerance : line_tolerance(road.line, extent.tolerance);
  extent.tolerance = tolerance;
  const SmoothLine smooth = compute(
      [&] { return line_over_ground(*road.ground, road.line, tolerance, k.ahead, k.threads); });
  const RoadCloud* const colored = cloud ? &*cloud : nullptr;
  const PlanCorridor where = corridor_of(road.line, extent);
  py::dict done = k.to == "opencrg"     ? written_crg(road, smooth, k, out)
                  : k.to == "opendrive" ? written_opendrive(road, smooth, k, out, folder)
                  : k.to == "geotiff"   ? written_geotiff(road, smooth, k, out, colored, where)
                                        : written_mesh(road, smooth, k, out, colored, where);
  done["length"] = smooth.length();
  done["geo_reference"] = road.geo_reference;
  return done;
}

}  // namespace

void bind_results(py::module_& module) {
  bind_render(module);
  const CrgGridOptions grid;
  const RoadExtent extent;
  module.def(
      "export",
      [](const py::object& source, const std::string& to, const fs::path& out,
         const py::object& along, const std::string& encoding, double step, double step_across,
         double left, double right, double widest, double smoothing, double ahead,
         std::optional<double> tolerance, double reach, const std::string& crg,
         const std::string& crs, bool vehicles, int threads) {
        return exported(source, out, along,
                        {to, encoding, crg, crs, step, step_across, left, right, widest, smoothing,
                         ahead, reach, tolerance, vehicles, threads});
      },
      py::arg("source"), py::arg("to"), py::arg("out"), py::kw_only(),
      py::arg("along") = py::none(), py::arg("encoding") = "text", py::arg("step") = grid.step_u,
      py::arg("step_across") = grid.step_v, py::arg("left") = grid.left,
      py::arg("right") = grid.right, py::arg("widest") = grid.widest,
      py::arg("smoothing") = grid.smoothing, py::arg("ahead") = extent.ahead,
      py::arg("tolerance") = py::none(), py::arg("reach") = 0.5, py::arg("crg") = "",
      py::arg("crs") = "", py::arg("vehicles") = false, py::arg("threads") = 0,
      with_keywords(
          "Writes a road for other programs, the same as camber export.",
          {{"source", "result folder, its surface.json, or a cloud in metres (N x 3, or a file)"},
           {"to", "'opencrg', 'opendrive', 'mesh' (.glb, .obj, .ply) or 'geotiff'"},
           {"along", "N x 3, m, in the source's frame; None: the driven line of a result"},
           {"encoding", "numbers of OpenCRG: 'text' or 'binary'"},
           {"step", "m along the line, or of a cell; 0: from the data"},
           {"step_across", "m across; 0: from the data"},
           {"left", "m to the left; 0: as far as is seen"},
           {"right", "m to the right"},
           {"widest", CAMBER_DOC(CrgGridOptions, widest)},
           {"smoothing", CAMBER_DOC(CrgGridOptions, smoothing)},
           {"ahead", CAMBER_DOC(RoadExtent, ahead)},
           {"tolerance", "m that the smooth line may pass a point by; None: by their scatter"},
           {"reach", "m that a place may lie beyond a patch's boundary"},
           {"crg", CAMBER_DOC(OpenDriveOptions, crg_file)},
           {"crs", "of a source that states none: EPSG:n or a definition"},
           {"vehicles", "of a result: its vehicles as objects of the OpenDRIVE road"}})
          .c_str());
}

}  // namespace camber::python
