// The output of `camber info` for a cloud.

#include "cloud_description.h"

#include <fmt/format.h>

#include <cmath>
#include <variant>

#include "camber/cloud/e57_file.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/las_names.h"

using nlohmann::json;

namespace camber::tools {
namespace {

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

json vector(const Eigen::Vector3d& v) {
  return json::array({number(v.x()), number(v.y()), number(v.z())});
}

json numbers(const std::array<double, 3>& v) {
  return json::array({number(v[0]), number(v[1]), number(v[2])});
}

std::string text(const Eigen::Vector3d& v) {
  return fmt::format("{:.3f} {:.3f} {:.3f}", v.x(), v.y(), v.z());
}

std::string fine_text(const Eigen::Vector3d& v) {
  return fmt::format("{:.8f} {:.8f} {:.3f}", v.x(), v.y(), v.z());
}

json unit_json(const CoordinateUnit& unit) {
  if (!unit.known()) return nullptr;
  json out = {{"name", unit.name}};
  if (!unit.angle) out["metres"] = unit.metres;
  return out;
}

/// Name of an extra byte's type, as the attributes have it; "uint16[3]" for more than one.
std::string extra_type(const LasExtraBytes& extra) {
  static const char* const kNames[] = {"uint8", "int8",   "uint16", "int16",   "uint32",
                                       "int32", "uint64", "int64",  "float32", "float64"};
  if (extra.type == 0) return "undocumented";
  const std::string name = kNames[(extra.type - 1) % 10];
  return extra.elements > 1 ? fmt::format("{}[{}]", name, extra.elements) : name;
}

json extra_json(const LasExtraBytes& extra) {
  json out = {{"name", extra.name},        {"description", extra.description},
              {"type", extra_type(extra)}, {"type_code", extra.type},
              {"options", extra.options},  {"size", extra.size}};
  const auto values = [&](const std::array<double, 3>& v) {
    if (extra.elements < 2) return number(v[0]);
    json all = json::array();
    for (std::size_t k = 0; k < extra.elements; ++k) all.push_back(number(v[k]));
    return all;
  };
  if (extra.options & 0x08) out["scale"] = values(extra.scale);
  if (extra.options & 0x10) out["offset"] = values(extra.offset);
  return out;
}

/// How many points have each flag of their class set.
json flags_json(const LasFile& las, const CloudSummary& summary) {
  json out = json::object();
  const char* const names[] = {"synthetic", "key_point", "withheld", "overlap"};
  for (const AttributeSummary& attribute : summary.attributes) {
    if (attribute.name != "class_flags") continue;
    for (const auto& [value, count] : attribute.counts) {
      for (int bit = 0; bit < (las.point_format >= 6 ? 4 : 3); ++bit) {
        if ((value >> bit & 1) == 0) continue;
        json& total = out[names[bit]];
        total = (total.is_null() ? std::uint64_t{0} : total.get<std::uint64_t>()) + count;
      }
    }
  }
  return out;
}

/// What in the header contradicts the file or its points, one sentence each.
std::vector<std::string> contradictions(const LasFile& las, const CloudSummary& summary) {
  std::vector<std::string> out = las.contradictions();
  for (const AttributeSummary& attribute : summary.attributes) {
    if (attribute.name != "return_number") continue;
    std::string header, points;
    bool same = true;
    for (std::size_t r = 1; r <= las.points_by_return.size(); ++r) {
      const auto found = attribute.counts.find(static_cast<int>(r));
      const std::uint64_t count = found == attribute.counts.end() ? 0 : found->second;
      same = same && count == las.points_by_return[r - 1];
      header += " " + std::to_string(las.points_by_return[r - 1]);
      points += " " + std::to_string(count);
    }
    if (!same) {
      out.push_back("the header counts points by return as" + header + ", they are" + points);
    }
  }
  return out;
}

json las_json(const LasFile& las, const CloudSummary& summary) {
  json records = json::array(), extended = json::array(), extras = json::array();
  for (const LasRecord& record : las.records) {
    (record.extended ? extended : records)
        .push_back({{"user_id", record.user_id},
                    {"record_id", record.record_id},
                    {"length", record.length},
                    {"description", record.description}});
  }
  for (const LasExtraBytes& extra : las.extra_bytes) extras.push_back(extra_json(extra));
  json out = {{"bytes", las.bytes->size()},
              {"version", "1." + std::to_string(las.minor)},
              {"file_source_id", las.file_source_id},
              {"global_encoding", las.global_encoding},
              {"system_identifier", las.system_identifier},
              {"generating_software", las.generating_software},
              {"creation", {las.creation_year, las.creation_day}},
              {"header_size", las.header_size},
              {"offset_to_points", las.points_start},
              {"vlr_count", records.size()},
              {"compressed", false},
              {"point_format", las.point_format},
              {"record_length", las.record_length},
              {"legacy_point_count", las.legacy_count},
              {"point_count", las.declared_count},
              {"points_present", las.points},
              {"points_by_return", las.points_by_return},
              {"scale", numbers(las.scale)},
              {"offset", numbers(las.offset)},
              {"header_min", numbers(las.minimum)},
              {"header_max", numbers(las.maximum)},
              {"vlrs", records},
              {"evlrs", extended},
              {"extra_bytes_per_point", las.extra_length()},
              {"extra_bytes", extras},
              {"flags", flags_json(las, summary)},
              {"contradictions", contradictions(las, summary)}};
  if (las.points_start > las.records_end) {
    out["gap_before_points"] = las.points_start - las.records_end;
  }
  return out;
}

const char* to_string(E57Field::Kind kind) {
  switch (kind) {
    case E57Field::Kind::kInteger:
      return "integer";
    case E57Field::Kind::kScaledInteger:
      return "scaled integer";
    case E57Field::Kind::kFloat32:
      return "float32";
    case E57Field::Kind::kString:
      return "text";
    case E57Field::Kind::kFloat64:
      break;
  }
  return "float64";
}

json pose_json(const std::optional<E57Pose>& pose) {
  if (!pose) return nullptr;
  return {{"rotation_wxyz", pose->rotation}, {"translation", pose->translation}};
}

json numbers_json(const E57Numbers& numbers) {
  json out = json::object();
  for (const auto& [name, value] : numbers) out[name] = number(value);
  return out;
}

/// Points of a scan that the file marks as invalid; nothing where it was not read.
std::optional<std::uint64_t> invalid_points(const ReadReport& report, std::size_t scan) {
  for (const auto& [number, count] : report.invalid_by_scan) {
    if (number == scan) return count;
  }
  return {};
}

json e57_json(const E57File& e57, const ReadReport& report) {
  json scans = json::array(), images = json::array(), extensions = json::object();
  for (std::size_t i = 0; i < e57.scans.size(); ++i) {
    const E57Scan& scan = e57.scans[i];
    json fields = json::array();
    for (const E57Field& field : scan.fields) {
      json entry = {{"name", field.name}, {"type", to_string(field.kind)}};
      if (field.kind == E57Field::Kind::kInteger || field.kind == E57Field::Kind::kScaledInteger) {
        entry["minimum"] = field.minimum;
        entry["maximum"] = field.maximum;
        entry["bits"] = field.bits();
      }
      if (field.kind == E57Field::Kind::kScaledInteger) {
        entry["scale"] = field.scale;
        entry["offset"] = field.offset;
      }
      fields.push_back(std::move(entry));
    }
    const std::optional<std::uint64_t> invalid = invalid_points(report, i);
    scans.push_back({{"scan", i},
                     {"guid", scan.guid},
                     {"name", scan.name},
                     {"description", scan.description},
                     {"sensor", {scan.sensor_vendor, scan.sensor_model, scan.sensor_serial}},
                     {"records", scan.points},
                     {"invalid", invalid ? json(*invalid) : json(nullptr)},
                     {"pose", pose_json(scan.pose)},
                     {"bounds", numbers_json(scan.bounds)},
                     {"limits", numbers_json(scan.limits)},
                     {"fields", fields}});
  }
  for (const E57Image& image : e57.images) {
    images.push_back(
        {{"guid", image.guid},
         {"name", image.name},
         {"description", image.description},
         {"scan_guid", image.scan_guid.empty() ? json(nullptr) : json(image.scan_guid)},
         {"pose", pose_json(image.pose)},
         {"representation", image.representation},
         {"media", image.media},
         {"bytes", image.length},
         {"parameters", numbers_json(image.numbers)}});
  }
  for (const auto& [prefix, name] : e57.extensions) extensions[prefix] = name;
  return {{"bytes", e57.bytes},
          {"version", fmt::format("{}.{}", e57.version_major, e57.version_minor)},
          {"guid", e57.guid},
          {"library", e57.library},
          {"coordinate_metadata", e57.coordinate_metadata},
          {"page_size", e57.page_size},
          {"pages", e57.pages},
          {"extensions", extensions},
          {"scans", scans},
          {"images", images}};
}

void add_e57_lines(const E57File& e57, const ReadReport& report, Description* out) {
  constexpr std::size_t kMost = 20;
  if (!e57.library.empty()) out->line("written by", e57.library);
  for (std::size_t i = 0; i < std::min(kMost, e57.scans.size()); ++i) {
    const E57Scan& scan = e57.scans[i];
    std::string line = scan.name.empty() ? std::string() : "'" + scan.name + "', ";
    line += fmt::format("{} records", scan.points);
    const std::optional<std::uint64_t> invalid = invalid_points(report, i);
    if (invalid && *invalid > 0) line += fmt::format(", {} of them invalid", *invalid);
    if (scan.pose) {
      const std::array<double, 4>& q = scan.pose->rotation;
      const double imaginary = std::sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
      const double angle = 2.0 * std::atan2(imaginary, std::abs(q[0])) * 180.0 / M_PI;
      line += fmt::format(", at {:.3f} {:.3f} {:.3f} m, turned by {:.2f} deg",
                          scan.pose->translation[0], scan.pose->translation[1],
                          scan.pose->translation[2], angle);
    } else {
      line += ", no pose";
    }
    out->line(fmt::format("scan {}", i), line);
  }
  if (e57.scans.size() > kMost) {
    out->line("scans", fmt::format("{} more (--json has all)", e57.scans.size() - kMost));
  }
  for (std::size_t i = 0; i < std::min(kMost, e57.images.size()); ++i) {
    const E57Image& image = e57.images[i];
    double width = 0.0, height = 0.0;
    for (const auto& [name, value] : image.numbers) {
      if (name == "imageWidth") width = value;
      if (name == "imageHeight") height = value;
    }
    out->line(fmt::format("image {}", i),
              fmt::format("{}{}, {:.0f} x {:.0f} px, {}, {} bytes{}",
                          image.name.empty() ? "" : "'" + image.name + "', ", image.representation,
                          width, height, image.media, image.length,
                          image.scan_guid.empty() ? "" : ", of scan " + image.scan_guid));
  }
  if (e57.images.size() > kMost) {
    out->line("images", fmt::format("{} more (--json has all)", e57.images.size() - kMost));
  }
}

json text_json(const ReadReport& report) {
  const TextLayout& layout = *report.text;
  json columns = json::array();
  for (const int column : layout.position) {
    columns.push_back(column >= 0 ? json(column) : json(nullptr));
  }
  json out = {{"separator", layout.separator},
              {"line_ends", layout.line_ends},
              {"decimal_sign", std::string(1, layout.decimal_sign)},
              {"header_lines", layout.header_lines},
              {"header", layout.header},
              {"columns", layout.columns},
              {"x_y_z_columns", columns}};
  if (layout.count_line) out["count_line"] = *layout.count_line;
  for (const PtxScan& scan : report.scans) {
    json rows = json::array();
    for (std::size_t r = 0; r < 4; ++r) {
      rows.push_back(
          {scan.pose[4 * r], scan.pose[4 * r + 1], scan.pose[4 * r + 2], scan.pose[4 * r + 3]});
    }
    out["scans"].push_back(
        {{"columns", scan.columns}, {"rows", scan.rows}, {"matrix_lines_7_to_10", rows}});
  }
  return out;
}

json attribute_json(const AttributeSummary& attribute) {
  json out = {{"name", attribute.name},
              {"type", attribute.type},
              {"min", number(attribute.minimum)},
              {"max", number(attribute.maximum)},
              {"non_finite", attribute.non_finite}};
  for (const auto& [value, count] : attribute.counts) {
    out["counts"][std::to_string(value)] = count;
  }
  return out;
}

/// "m", "ft" and the like for the headings of lines.
std::string unit_mark(const CloudSummary& summary) {
  if (!summary.crs || !summary.crs->horizontal.known()) return summary.metric ? "m" : "units";
  const CoordinateUnit& h = summary.crs->horizontal;
  return h.metre() ? "m" : h.name;
}

/// Unit of an attribute's values, with a blank before it; empty where it has none.
std::string unit_behind(const CloudSummary& summary, const std::string& attribute) {
  const std::string mark = unit_mark(summary);
  if (attribute == "x" || attribute == "y" || attribute == "sigma") return " " + mark;
  if (attribute == "z") {
    const bool known = summary.crs && summary.crs->vertical.known();
    return " " + (known && !summary.crs->vertical.metre() ? summary.crs->vertical.name
                  : known                                 ? "m"
                                                          : mark);
  }
  if (attribute == "scan_angle" || attribute == "scan_angle_rank") return " degrees";
  if (attribute == "gps_time") return " s";
  return {};
}

/// The table of classes.
void add_class_lines(const CloudSummary& summary, Description* out) {
  for (const AttributeSummary& attribute : summary.attributes) {
    if (attribute.name != "classification" || attribute.counts.empty()) continue;
    out->line("classes", "");
    out->lines += fmt::format("    {:>3} {:<20} {:>12} {:>9}\n", "", "class", "points", "share");
    for (const auto& [value, count] : attribute.counts) {
      out->lines +=
          fmt::format("    {:>3} {:<20} {:>12} {:>7.2f} %\n", value, las_class_name(value), count,
                      100.0 * static_cast<double>(count) /
                          static_cast<double>(std::max<std::uint64_t>(1, summary.points)));
    }
  }
}

}  // namespace

void Description::line(const std::string& name, const std::string& value) {
  lines += fmt::format("  {:<13} {}\n", name, value);
}

json to_json(const CoordinateSystem& system) {
  json keys = json::object();
  for (const auto& entry : system.geotiff_keys) {
    const std::string name = geotiff_key_name(entry.first);
    std::visit([&](const auto& v) { keys[name] = v; }, entry.second);
  }
  json out = {
      {"kind", to_string(system.kind)},
      {"name", system.name.empty() ? json(nullptr) : json(system.name)},
      {"epsg", system.epsg > 0 ? json(system.epsg) : json(nullptr)},
      {"vertical_epsg", system.vertical_epsg > 0 ? json(system.vertical_epsg) : json(nullptr)},
      {"unit", unit_json(system.horizontal)},
      {"vertical_unit", unit_json(system.vertical)},
      {"vertical_unit_stated", system.vertical_stated},
      {"wkt_bit", system.wkt_bit}};
  if (!system.wkt.empty()) {
    out["wkt"] = system.wkt;
    out["wkt_source"] = system.given ? "option" : "file";
  }
  if (!keys.empty()) out["geotiff_keys"] = keys;
  return out;
}

Description describe_cloud(const std::string& path, const CloudSummary& summary) {
  Description out;
  const ReadReport& report = summary.report;
  json& o = out.object;
  o["file"] = path;
  o["kind"] = "cloud";
  o["format"] = to_string(report.format);
  o["encoding"] = report.encoding;
  o["points"] = summary.points;
  o["non_finite"] = summary.non_finite;
  o["frame"] = to_string(summary.frame);
  o["metric"] = summary.metric;
  o["bounds"] = {{"min", vector(summary.minimum)}, {"max", vector(summary.maximum)}};
  if (summary.origin) o["origin"] = vector(*summary.origin);
  o["mean"] = vector(summary.mean);
  o["crs"] = summary.crs ? to_json(*summary.crs) : json(nullptr);
  o["attributes"] = json::array();
  json first = json::object(), last = json::object();
  for (const AttributeSummary& attribute : summary.attributes) {
    o["attributes"].push_back(attribute_json(attribute));
    first[attribute.name] = number(attribute.first);
    last[attribute.name] = number(attribute.last);
  }
  if (summary.points > 0) {
    o["first_point"] = first;
    o["last_point"] = last;
  }
  if (summary.las) o["las"] = las_json(*summary.las, summary);
  if (summary.e57) o["e57"] = e57_json(*summary.e57, report);
  if (report.text) o["text"] = text_json(report);
  if (report.width > 0) o["organised"] = {{"width", report.width}, {"height", report.height}};
  if (report.faces > 0) o["faces"] = report.faces;
  if (std::isfinite(summary.sigma_mean)) {
    o["sigma"] = {{"mean_m", summary.sigma_mean},
                  {"median_m", number(summary.sigma_median)},
                  {"quantile_95_m", number(summary.sigma_95)}};
  }
  if (report.outside > 0) o["outside_bounds"] = report.outside;
  o["dropped"] = json::object();
  for (const auto& [reason, count] : report.dropped) o["dropped"][reason] = count;
  o["notes"] = report.notes;
  if (!report.las_only.empty()) o["las_only"] = report.las_only;

  out.line("format", std::string(to_string(report.format)) + ", " + report.encoding);
  out.line("points",
           std::to_string(summary.points) +
               (summary.non_finite > 0 ? fmt::format(" ({} not finite)", summary.non_finite)
                                       : std::string()));
  if (report.outside > 0)
    out.line("left out", fmt::format("{} outside of the bounds", report.outside));
  if (summary.e57) add_e57_lines(*summary.e57, report, &out);
  if (report.width > 0) out.line("organised", fmt::format("{} x {}", report.width, report.height));
  if (report.faces > 0) out.line("faces", std::to_string(report.faces));
  if (summary.points > summary.non_finite) {
    const std::string unit = unit_mark(summary);
    const bool degrees = summary.crs && summary.crs->horizontal.angle;
    out.line("min [" + unit + "]", degrees ? fine_text(summary.minimum) : text(summary.minimum));
    out.line("max [" + unit + "]", degrees ? fine_text(summary.maximum) : text(summary.maximum));
  }
  out.line("frame", std::string(to_string(summary.frame)) +
                        (summary.metric || summary.crs ? "" : ", up to scale"));
  if (summary.crs) out.line("coordinates", describe(*summary.crs));
  const std::string length = summary.metric || summary.crs ? "m" : "units";
  if (summary.origin) out.line("origin [" + length + "]", text(*summary.origin));
  if (std::isfinite(summary.sigma_mean)) {
    out.line("sigma [" + length + "]",
             fmt::format("mean {:.4g}, median {:.3g}, 95 % below {:.3g}", summary.sigma_mean,
                         summary.sigma_median, summary.sigma_95));
  }
  out.line("attributes", "");
  for (const AttributeSummary& attribute : summary.attributes) {
    out.lines += fmt::format(
        "    {:<21} {:<8} {:.10g} to {:.10g}{}{}\n", attribute.name, attribute.type,
        attribute.minimum, attribute.maximum, unit_behind(summary, attribute.name),
        attribute.non_finite > 0 ? fmt::format(", {} not finite", attribute.non_finite) : "");
  }
  add_class_lines(summary, &out);
  for (const auto& [reason, count] : report.dropped) {
    out.line("dropped", fmt::format("{}: {}", reason, count));
  }
  for (const std::string& note : report.notes) out.line("note", note);
  if (summary.las) {
    for (const std::string& what : report.las_only) {
      out.line("note", what + ": kept from LAS to LAS (or LAZ) alone");
    }
    for (const std::string& what : contradictions(*summary.las, summary)) out.line("note", what);
  }
  return out;
}

}  // namespace camber::tools
