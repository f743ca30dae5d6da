#include "camber/render/report.h"

#include <ceres/version.h>
#include <vtkVersionMacros.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core/version.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/render/base64.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/report_html.h"
#include "camber/render/gltf.h"
#include "camber/render/picture_space.h"
#include "camber/render/plot.h"
#include "camber/render/report_viewer.h"
#include "camber/render/result_plots.h"
#include "camber/render/wireframe.h"
#include "camber/road/road_profile.h"
#include "camber/scene/findings.h"
#include "camber/scene/vehicle_numbers.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using detail::escape;
using detail::flatten;
using detail::folded;
using detail::number;
using detail::page_head;
using detail::plot_figure;
using detail::row;
using detail::status_cell;
using detail::table;
using detail::with_margin;
using nlohmann::json;

constexpr double kDegrees = 180.0 / M_PI;

std::string read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  if (!in) throw InputError(path.string(), "cannot be read");
  return out.str();
}

/// Larger pictures of a camera go in as JPEG, with a sixth of the bytes.
constexpr std::size_t kLargePhoto = 200000;

/// An image with areas that answer to pointing.
/// @param jpegs   of photographs; null: the picture is drawn
/// @param places  HTML of the areas, relative to the image
std::string figure(const fs::path& file, const std::string& caption,
                   const std::map<std::string, std::string>* jpegs,
                   const std::string& places = {}) {
  std::string bytes = read_bytes(file), type = "png";
  if (jpegs && bytes.size() > kLargePhoto) {
    const auto found = jpegs->find(file.filename().string());
    bytes = found != jpegs->end() ? found->second : encode_jpeg(read_color_image(file));
    type = "jpeg";
  }
  return std::string("<figure class=answers><div class=\"p") + (jpegs ? "" : " drawn") +
         "\"><div class=at><img alt=\"" + escape(caption) + "\" src=\"data:image/" + type +
         ";base64," + base64(bytes) + "\">" + places + "</div></div>" +
         (places.empty() ? "" : "<output class=said></output>") + "<figcaption>" + escape(caption) +
         "</figcaption></figure>\n";
}

/// Areas over a frame's image, one a vehicle: its detection box, with what is known of it.
std::string vehicle_places(const PictureContent& picture, int id, const std::string& unit) {
  std::string out;
  if (!picture.vehicles || !picture.camera) return out;
  const double w = picture.camera->width, h = picture.camera->height;
  const VehicleNumbers numbers(*picture.vehicles);
  for (const VehicleFrame& frame : picture.vehicles->frames) {
    if (frame.id != id) continue;
    for (const VehicleEstimate& v : frame.vehicles) {
      const Box2 box = v.box.clipped(picture.camera->width, picture.camera->height);
      if (!(box.width() > 0.0) || !(box.height() > 0.0)) continue;
      std::string facts = vehicle_name(v, numbers.of(frame.id, v)) + " (id " +
                          std::to_string(v.id) + " of frame " + std::to_string(frame.id) + "): ";
      if (has_box(v)) {
        facts +=
            format_with_sigma(v.pose.bottom_center().norm(), range_sigma(v)) + " " + unit + ", ";
      }
      facts += v.status == Status::kNotObservable ? "not observable" : to_string(v.status);
      if (!v.reason.empty()) facts += ", " + v.reason;
      if (!v.plane_source.empty()) {
        facts += "; on " + v.plane_source;
        if (std::isfinite(v.plane_sigma_height)) {
          facts += ", height ± " + format_number(v.plane_sigma_height, 3) + " " + unit;
        }
      }
      out += "<span class=hit tabindex=0 style=\"left:" + number(100.0 * box.x1 / w, 2) +
             "%;top:" + number(100.0 * box.y1 / h, 2) +
             "%;width:" + number(100.0 * box.width() / w, 2) +
             "%;height:" + number(100.0 * box.height() / h, 2) + "%\" title=\"" + escape(facts) +
             "\"></span>";
    }
  }
  return out;
}

/// A page holds at most so many overlays besides the shown frame's.
constexpr std::size_t kOtherOverlays = 12;

/// "overlay_000012" to "12".
std::string frame_number(const std::string& stem) {
  const std::string digits = stem.substr(std::min(stem.size(), stem.find('_') + 1));
  const std::size_t from = digits.find_first_not_of('0');
  return digits.empty() ? stem : from == std::string::npos ? "0" : digits.substr(from);
}

/// What the shown frame's picture holds, as write_reconstruction() draws it.
std::string overlay_caption(const PictureContent& picture, const std::string& unit) {
  if (picture.vehicles) {
    for (const VehicleFrame& frame : picture.vehicles->frames) {
      if (frame.id == picture.frame && !frame.vehicles.empty()) {
        return ": wireframes, boxes and distances; a metre grid on the plane under each vehicle";
      }
    }
  }
  return ": the road's patches by their grade, and distances ahead (" + unit + ")";
}

/// What each source knows of the scale, where there are any.
std::string evidence_section(const RunDocument& run) {
  try {
    return "<h2>What is known of the scale</h2>\n" + plot_figure(evidence_plots(run)) +
           "<p class=n>Each source by itself, the road's shape being known as far as it is.</p>\n";
  } catch (const NoAnswerError&) {
    return {};
  }
}

/// Height, grade and cross slope along the driven line, where the surface covers some of it.
std::string profile_section(const RoadSurface& surface) {
  const auto& line = surface.driven_line;
  double length = 0.0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (!line[i].allFinite()) return {};
    if (i > 0) length += (line[i] - line[i - 1]).norm();
  }
  if (!(length > 0.0)) return {};
  ProfileOptions options;
  if (surface.metric) {
    options.step = std::max(0.5, length / 200.0);
  } else {
    options.step = length / 60.0;
    options.length = length / 4.0;
    options.reach = options.step;
  }
  try {
    const PlotSheet sheet = profile_plots(road_profile(surface, line, options), surface.metric, {});
    return "<h2>Profile along the driven line</h2>\n" + plot_figure(sheet) +
           "<p class=n>Point at a curve to read it. The bands are one standard deviation, by the "
           "covariance of the patches." +
           (surface.frame == "camera" ? " Heights count from the camera of the reference frame."
                                      : "") +
           "</p>\n";
  } catch (const NoAnswerError&) {
    return {};
  } catch (const std::invalid_argument&) {
    return {};  // a line without two places in plan
  }
}

/// Tables of more rows, and frames beyond so many, are shown on demand.
constexpr std::size_t kLongTable = 40, kManyFrames = 6;

std::string patch_section(const RoadSurface& surface, const std::string& unit) {
  if (surface.patches.empty()) return {};
  std::string rows;
  for (const PlanePatch& patch : surface.patches) {
    const Eigen::Vector3d& c = patch.plane.centroid;
    const Eigen::Matrix3d& cov = patch.plane.covariance;
    rows += row({std::to_string(patch.id), std::string(to_string(patch.kind)),
                 status_cell(patch.status, patch.reason),
                 number(c.x(), 1) + " " + number(c.y(), 1) + " " + number(c.z(), 1),
                 with_margin(patch.grade * kDegrees,
                             std::hypot(std::sqrt(cov(1, 1)), surface.level_sigma) * kDegrees, 2),
                 with_margin(patch.bank * kDegrees,
                             std::hypot(std::sqrt(cov(0, 0)), surface.level_sigma) * kDegrees, 2),
                 "<span class=m>&plusmn; " + number(std::sqrt(cov(2, 2)), 3) + "</span>",
                 std::to_string(patch.inliers),
                 patch.refinement.empty() ? "&ndash;" : escape(patch.refinement)});
  }
  const std::string all = table({"id", "kind", "status", "centre (" + unit + ")", "grade (&deg;)",
                                 "bank (&deg;)", "height (" + unit + ")", "points", "refinement"},
                                rows);
  const std::string level = surface.level == RoadSurface::Level::kGravity
                                ? "Grades and banks are against gravity."
                                : "Grades and banks are against the reference camera's level: no "
                                  "frame of the run knows gravity (--up of camber import).";
  return "<h2>Patches</h2>\n<p class=n>" + level + "</p>\n" +
         folded(all, std::to_string(surface.patches.size()) + " patches",
                surface.patches.size() > kLongTable);
}

/// "car 3" beside a patch of its colour.
std::string vehicle_cell(const VehicleEstimate& vehicle, int number) {
  const Color color = vehicle_color(vehicle.status, number);
  char hex[8];
  std::snprintf(hex, sizeof hex, "#%02x%02x%02x", color.red, color.green, color.blue);
  return std::string("<i class=k style=\"background:") + hex + "\"></i>" +
         escape(vehicle_name(vehicle, number));
}

/// @param shown  id of the frame that is open where frames are many.
std::string vehicle_section(const VehicleDocument& document, int shown, const std::string& unit) {
  std::string out;
  const VehicleNumbers numbers(document);
  for (const VehicleFrame& frame : document.frames) {
    std::string rows;
    for (const VehicleEstimate& v : frame.vehicles) {
      const std::string name = vehicle_cell(v, numbers.of(frame.id, v));
      if (!has_box(v)) {
        rows += row({name, std::to_string(v.id), status_cell(v.status, v.reason), "&ndash;",
                     "&ndash;", "&ndash;", "&ndash;", "&ndash;", "&ndash;"});
        continue;
      }
      const Eigen::Vector3d bottom = v.pose.bottom_center();
      const double sigma_yaw = std::sqrt(std::max(0.0, v.covariance(4, 4)));
      const Dimensions& d = v.pose.dimensions;
      rows +=
          row({name, std::to_string(v.id), status_cell(v.status, v.reason),
               with_margin(bottom.norm(), range_sigma(v), 2),
               number(bottom.x(), 2) + " " + number(bottom.y(), 2) + " " + number(bottom.z(), 2),
               with_margin(rotation_y(v.pose.camera_from_vehicle.rotation_matrix()) * kDegrees,
                           sigma_yaw * kDegrees, 1),
               number(d.length, 2) + " &times; " + number(d.width, 2) + " &times; " +
                   number(d.height, 2),
               escape(v.plane_source) + " <span class=m>&plusmn; " +
                   number(v.plane_sigma_height, 3) + "</span>",
               number(v.reprojection_rmse_px, 1)});
    }
    if (rows.empty()) continue;
    const std::string title = "Frame " + std::to_string(frame.id);
    const std::string all =
        table({"vehicle", "id", "status", "distance (" + unit + ")", "bottom centre (" + unit + ")",
               "rotation_y (&deg;)", "l &times; w &times; h (" + unit + ")",
               "ground (" + unit + ")", "reprojection (px)"},
              rows);
    const bool fold = document.frames.size() > kManyFrames && frame.id != shown;
    out += fold ? folded(all, title, true) : "<h3>" + title + "</h3>\n" + all;
  }
  if (out.empty()) return {};
  std::string head = "<h2>Vehicles</h2>\n<p class=n>Method " + escape(document.method);
  if (!document.detections_source.empty()) {
    head += ", detections: " + escape(document.detections_source);
  }
  return head +
         ". A vehicle has one number over all frames, its track, and so one colour in all "
         "pictures; the id is its own in each frame of vehicles.json.</p>\n" +
         out;
}

/// A line a matched vehicle.
std::string vehicle_errors(const json& metrics) {
  const auto vehicles = metrics.find("vehicles");
  if (vehicles == metrics.end() || !vehicles->is_array() || vehicles->empty()) return {};
  std::string rows;
  for (const json& vehicle : *vehicles) {
    if (!vehicle.is_object()) continue;
    const auto cell = [&](const char* name, int decimals) -> std::string {
      const auto found = vehicle.find(name);
      return found != vehicle.end() && found->is_number() ? number(found->get<double>(), decimals)
                                                          : "&ndash;";
    };
    rows += row({cell("frame", 0), cell("estimate_id", 0), cell("truth_id", 0), cell("distance", 1),
                 cell("center_error", 2), cell("along_error", 2), cell("height_error", 3),
                 cell("normal_error_deg", 2), cell("yaw_error_deg", 1), cell("dimension_error", 2),
                 cell("keypoint_error", 2)});
  }
  return "<details open><summary>Vehicle by vehicle</summary>" +
         table({"frame", "id", "true id", "distance (m)", "centre (m)", "along the ray (m)",
                "ground height (m)", "normal (&deg;)", "yaw (&deg;)", "size (m)", "keypoints (m)"},
               rows) +
         "</details>\n";
}

std::string metrics_section(const json& metrics) {
  if (!metrics.is_object()) return {};
  std::string rows;
  json overall = metrics;
  overall.erase("vehicles");
  overall.erase("by_distance");
  flatten(overall, "", &rows);
  std::string out = "<h2>Errors against the truth</h2>\n";
  const auto by_distance = metrics.find("by_distance");
  if (by_distance != metrics.end() && by_distance->is_object()) {
    std::string bins;
    const std::pair<const char*, const char*> kBins[] = {{"to_15", "up to 15"},
                                                         {"15_to_30", "15 to 30"},
                                                         {"beyond_30", "beyond 30"},
                                                         {"all", "all"}};
    for (const auto& [name, title] : kBins) {
      const auto bin = by_distance->find(name);
      if (bin == by_distance->end()) continue;
      const auto cell = [&, &b = *bin](const char* what, const char* which) -> std::string {
        const auto group = b.find(what);
        if (group == b.end() || !group->is_object()) return "&ndash;";
        const auto found = group->find(which);
        if (found == group->end() || !found->is_number()) return "&ndash;";
        return number(found->get<double>(), std::string(which) == "count" ? 0 : 3);
      };
      bins += row({title, cell("height_error", "count"), cell("height_error", "median"),
                   cell("height_error", "p90"), cell("center_error", "mean"),
                   cell("center_error", "median"), cell("center_error", "p90")});
    }
    out += table({"distance (m)", "vehicles", "ground height, median (m)", "90 % (m)",
                  "centre, mean (m)", "median (m)", "90 % (m)"},
                 bins);
  }
  out += vehicle_errors(metrics);
  return out + "<details><summary>All figures</summary>" + table({"name", "value"}, rows) +
         "</details>\n";
}

/// ", Ceres 2.1.0, ..." as far as the run names them.
std::string libraries(const RunDocument& run) {
  std::string out;
  const auto found = run.extra->find("libraries");
  if (found == run.extra->end() || !found->is_object()) return out;
  for (const auto& [name, version] : found->items()) {
    if (version.is_string()) out += ", " + escape(name + " " + version.get<std::string>());
  }
  return out;
}

/// What is not ok, why, and which option would change it; nothing for a complete run.
std::string shortcoming_section(const PictureContent& picture) {
  if (!picture.run) return {};
  std::string rows;
  std::size_t count = 0;
  for (const Shortcoming& s : shortcomings(*picture.run, picture.surface, picture.vehicles)) {
    ++count;
    rows += row(
        {"<td class=w>" + escape(s.what) + "</td>",
         s.status.empty() ? "&ndash;"
                          : escape(s.status == "not_observable" ? "not observable" : s.status),
         "<td class=w>" + escape(s.reason) + "</td>", "<td class=w>" + escape(s.remedy) + "</td>"});
  }
  if (rows.empty()) return {};
  const std::string all = table({"what", "status", "reason", "what you can do"}, rows);
  return "<details id=shortcomings><summary>" + std::to_string(count) +
         (count == 1 ? " thing is" : " things are") +
         " missing, weak or not used, and what you can do</summary>" + all + "</details>\n";
}

std::string run_section(const RunDocument& run) {
  std::string out = "<h2>Run</h2>\n";
  double total = 0.0, longest = 0.0;
  for (const auto& [stage, ms] : run.timings.stages()) {
    total += ms;
    longest = std::max(longest, ms);
  }
  if (total > 0.0) {
    std::string rows;
    for (const auto& [stage, ms] : run.timings.stages()) {
      rows += row(
          {escape(stage), number(ms, 1),
           "<td class=bar><i style=\"width:" + number(100.0 * ms / longest, 1) + "%\"></i></td>"});
    }
    rows += row({"<td><b>sum</b></td>", number(total, 1), ""});
    out += table({"stage", "ms", ""}, rows);
  }
  std::string facts =
      row({"version", "Camber " + escape(kVersion) + libraries(run)}) +
      row({"seed", std::to_string(run.seed)}) +
      row({"scale", run.metric ? with_margin(run.scale, run.scale * run.scale_sigma, 4) +
                                     " m per unit of the motion"
                               : "unknown: the result is up to scale"});
  if (!run.gl_backend.empty()) facts += row({"pictures drawn by", escape(run.gl_backend)});
  const auto command = run.extra->find("command");
  if (command != run.extra->end() && command->is_string()) {
    facts += row({"command", "<code>" + escape(command->get<std::string>()) + "</code>"});
  }
  for (const auto& [name, count] : run.points_kept) {
    facts += row({"points kept: " + escape(name), std::to_string(count)});
  }
  for (const auto& [reason, count] : run.points_dropped) {
    facts += row({"points dropped: " + escape(reason), std::to_string(count)});
  }
  flatten(*run.options, "option", &facts);
  out += table({"what", "value"}, facts);
  if (!run.input_hashes.empty()) {
    std::string rows;
    for (const auto& [path, hash] : run.input_hashes) {
      rows += row({escape(path), "<code>" + escape(hash) + "</code>"});
    }
    out += "<details><summary>Hashes of the inputs (XXH3, 128 bits)</summary>" +
           table({"file", "hash"}, rows) + "</details>\n";
  }
  return out;
}

bool is_metric(const PictureContent& picture) {
  if (picture.run) return picture.run->metric;
  return !picture.surface || picture.surface->metric;
}

/// What the run found, in sentences.
std::string finding_section(const PictureContent& picture) {
  std::string text;
  for (const Finding& finding : findings(*picture.run, picture.surface, picture.vehicles)) {
    text += (text.empty() ? "" : " ") + finding.text;
  }
  return "<p>" + escape(text) + "</p>\n";
}

/// What the result holds, and what units and margins mean.
std::string summary_section(std::string summary, bool metric) {
  if (!metric) summary += "; up to scale";
  summary += ". ± is one standard deviation (1 sigma) on all of this page; lengths are in " +
             std::string(metric ? "metres" : "units of the result") + ", angles in degrees.";
  return "<p class=n>" + escape(summary) + "</p>\n";
}

/// The overlays of a folder by name; none where it cannot be read.
std::vector<fs::path> overlay_files(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> overlays;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("overlay_", 0) == 0 && entry.path().extension() == ".png") {
      overlays.push_back(entry.path());
    }
  }
  std::sort(overlays.begin(), overlays.end());
  return overlays;
}

/// Overlays of the frames that are not shown, on demand; of many an even choice.
std::string other_overlays(const ReportContent& content, const std::vector<fs::path>& overlays,
                           const std::string& unit) {
  if (overlays.empty()) return {};
  std::string figures;
  const std::size_t step = (overlays.size() + kOtherOverlays - 1) / kOtherOverlays;
  std::size_t drawn = 0;
  for (std::size_t i = 0; i < overlays.size(); i += step, ++drawn) {
    const std::string frame = frame_number(overlays[i].stem().string());
    figures += figure(overlays[i], "Frame " + frame, &content.overlay_jpegs,
                      vehicle_places(content.picture, std::atoi(frame.c_str()), unit));
  }
  const std::string of = drawn < overlays.size()
                             ? std::to_string(drawn) + " of the " + std::to_string(overlays.size())
                             : std::string("the");
  return "<details><summary>Overlays of " + of + " other frames</summary>\n" + figures +
         "</details>\n";
}

/// The pictures of the folder: the shown frame, the scene, the view from above, other frames.
std::string picture_section(const ReportContent& content, bool has_truth, const std::string& unit) {
  const PictureContent& picture = content.picture;
  const fs::path& folder = content.picture_folder;
  std::vector<fs::path> overlays = overlay_files(folder);
  char wanted[48];
  std::snprintf(wanted, sizeof(wanted), "overlay_%06d.png", picture.frame);
  const auto shown = std::find_if(overlays.begin(), overlays.end(),
                                  [&](const fs::path& path) { return path.filename() == wanted; });
  std::string out;
  if (shown != overlays.end()) {
    out += figure(*shown, "Frame " + std::to_string(picture.frame) + overlay_caption(picture, unit),
                  &content.overlay_jpegs, vehicle_places(picture, picture.frame, unit));
    overlays.erase(shown);
  }
  std::error_code error;
  if (fs::exists(folder / "scene.png", error)) {
    out += figure(folder / "scene.png",
                  has_truth ? "The reconstruction in 3D and from the side; true boxes in red"
                            : "The reconstruction in 3D and from the side",
                  nullptr);
  }
  if (fs::exists(folder / "bev.png", error)) {
    out += figure(folder / "bev.png", "From above", nullptr);
  }
  for (const auto& [name, caption] :  // of camber compare
       {std::pair("height_error.png", "Signed height errors: blue too low, orange too high"),
        std::pair("histogram.png", "Distances in both directions"),
        std::pair("cumulative.png", "Share of the points within a distance")}) {
    if (fs::exists(folder / name, error)) out += figure(folder / name, caption, nullptr);
  }
  return out + other_overlays(content, overlays, unit);
}

/// The 3D view, with its data.
std::string view_section(const PictureContent& picture, std::size_t max_points) {
  GltfOptions gltf;
  gltf.max_points = max_points;
  gltf.point_facts = true;
  return "<div id=viewbar></div><canvas id=view></canvas><output id=viewsaid></output>"
         "<p class=n id=viewnote hidden>Click a vehicle, a patch, a point or a camera to read what "
         "is known of it. Drag to turn, with the right button or two fingers to move, wheel or "
         "pinch to come nearer, double click to start over.</p>\n"
         "<script type=\"application/octet-stream\" id=glb>" +
         base64(encode_glb(picture, gltf)) + "</script>\n<script>" + kReportViewer + "</script>\n";
}

/// What made the page, and the frame of its coordinates.
std::string origin_section(const PictureContent& picture) {
  const bool of_camera = picture.surface ? picture.surface->frame == "camera"
                         : picture.cloud ? picture.cloud->frame == CloudFrame::kCamera
                                         : true;
  return "<p class=n>Made by Camber " + std::string(kVersion) + ". Coordinates: " +
         (of_camera ? "camera of the reference frame, x right, y down, z ahead, except for "
                      "vehicles, which are in the camera of their own frame."
                    : "those of the input.") +
         "</p>\n";
}

}  // namespace

json library_versions() {
  return {
      {"Ceres", CERES_VERSION_STRING},
      {"Eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) +
                    "." + std::to_string(EIGEN_MINOR_VERSION)},
      {"OpenCV", CV_VERSION},
      {"VTK", VTK_VERSION}};
}

void ReportOptions::validate() const {
  if (max_points < 1) {
    throw std::invalid_argument("report option max_points: found 0, expected at least 1");
  }
}

std::string make_report(const ReportContent& content, const ReportOptions& options) {
  options.validate();
  const PictureContent& picture = content.picture;
  const bool metric = is_metric(picture);
  const std::string unit = metric ? "m" : "units";
  std::optional<PictureSpace> space;  // none: there is nothing to draw, and the page has the reason
  std::string summary;
  try {
    space = make_picture_space(picture, true, {});
    summary = content_summary(picture, *space);
  } catch (const NoAnswerError& nothing) {
    summary = nothing.what();
  }

  std::string out = page_head(picture.title.empty() ? "Reconstruction" : picture.title);
  if (picture.run) out += finding_section(picture);
  if (!content.picture_folder.empty()) {
    out += picture_section(content, space && !space->truth.empty(), unit);
  }
  if (picture.vehicles) out += vehicle_section(*picture.vehicles, picture.frame, unit);
  out += summary_section(summary, metric);
  out += shortcoming_section(picture);
  if (options.embed_3d && space) out += view_section(picture, options.max_points);
  if (picture.surface) out += profile_section(*picture.surface);
  out += metrics_section(*content.metrics);
  if (picture.surface) out += patch_section(*picture.surface, unit);
  if (picture.run) out += evidence_section(*picture.run) + run_section(*picture.run);
  out += origin_section(picture);
  if (options.embed_3d) out += std::string("<script>") + kReportAnswers + "</script>\n";
  return out + "</body></html>\n";
}

ReportContent report_of_result(const PictureContent& content, const fs::path& result) {
  ReportContent out;
  out.picture = content;
  std::error_code error;
  if (!fs::is_directory(result, error)) return out;
  out.picture_folder = result;
  const fs::path metrics = result / "metrics.json";
  if (!fs::exists(metrics, error)) return out;
  out.metrics = json::parse(read_bytes(metrics), nullptr, false);
  if (out.metrics->is_discarded()) {
    throw InputError(metrics.string(), "is no JSON, expected the metrics of a run");
  }
  return out;
}

void write_report(const ReportContent& content, const fs::path& path,
                  const ReportOptions& options) {
  write_file_atomically(path, make_report(content, options));
}

}  // namespace camber
