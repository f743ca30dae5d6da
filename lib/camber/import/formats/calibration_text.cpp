#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "camber/cloud/colmap.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/text_rows.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

// ---- COLMAP and kapture -------------------------------------------------------------------------

/// Parameters before the distortion, and what the distortion's coefficients are.
struct ColmapForm {
  std::size_t focals, coefficients;
  enum { kNone, kOpenCv, kFisheye, kOther } lens;
};

const std::map<std::string, ColmapForm>& colmap_forms() {
  // colmap/src/colmap/sensor/models.h describes the models and the order of their parameters.
  static const std::map<std::string, ColmapForm> forms = {
      {"SIMPLE_PINHOLE", {1, 0, ColmapForm::kNone}},
      {"PINHOLE", {2, 0, ColmapForm::kNone}},
      {"SIMPLE_RADIAL", {1, 1, ColmapForm::kOpenCv}},
      {"RADIAL", {1, 2, ColmapForm::kOpenCv}},
      {"OPENCV", {2, 4, ColmapForm::kOpenCv}},
      {"FULL_OPENCV", {2, 8, ColmapForm::kOpenCv}},
      {"OPENCV_FISHEYE", {2, 4, ColmapForm::kFisheye}},
      {"SIMPLE_RADIAL_FISHEYE", {1, 1, ColmapForm::kFisheye}},
      {"RADIAL_FISHEYE", {1, 2, ColmapForm::kFisheye}},
      {"FOV", {2, 1, ColmapForm::kOther}},
      {"THIN_PRISM_FISHEYE", {2, 8, ColmapForm::kOther}},
      {"RAD_TAN_THIN_PRISM_FISHEYE", {2, 12, ColmapForm::kOther}},
      {"SIMPLE_DIVISION", {1, 1, ColmapForm::kOther}},
      {"DIVISION", {2, 1, ColmapForm::kOther}},
      {"SIMPLE_FISHEYE", {1, 0, ColmapForm::kFisheye}},
      {"FISHEYE", {2, 0, ColmapForm::kFisheye}}};
  return forms;
}

/// @return nothing where the parameters are not as many as the model's.
bool set_colmap_camera(const std::string& model, const std::vector<double>& values,
                       CameraCalibration* out) {
  const ColmapForm& form = colmap_forms().at(model);
  if (values.size() != form.focals + 2 + form.coefficients) return false;
  out->model = model;
  out->first_pixel = 0.5;  // COLMAP's convention: the corner of the image is (0, 0)
  out->fx = values[0];
  out->fy = values[form.focals - 1];
  out->cx = values[form.focals];
  out->cy = values[form.focals + 1];
  out->coefficients.assign(values.begin() + static_cast<std::ptrdiff_t>(form.focals) + 2,
                           values.end());
  if (form.lens == ColmapForm::kOpenCv) set_opencv_lens(out, out->coefficients);
  if (form.lens == ColmapForm::kFisheye) set_fisheye_lens(out, out->coefficients);
  if (form.lens == ColmapForm::kOther) {
    out->unsupported = "its camera model " + model + " is not supported";
  }
  return true;
}

CalibrationFile colmap_calibration(const fs::path& path, const std::string& text) {
  CalibrationFile out;
  out.form = "COLMAP cameras";
  for (const ColmapCamera& camera : parse_colmap_cameras(text.data(), text.size(), path.string())) {
    CameraCalibration one;
    one.name = std::to_string(camera.id);
    if (camera.width > 65535 || camera.height > 65535) {
      throw InputError(path.string(),
                       fmt::format("found a camera of {} x {} pixels, expected up to 65535",
                                   camera.width, camera.height));
    }
    one.width = static_cast<int>(camera.width);
    one.height = static_cast<int>(camera.height);
    if (!colmap_forms().count(camera.model)) {
      one.model = camera.model;
      one.coefficients = camera.parameters;
      one.unsupported = "its camera model " + printable(camera.model) + " is not known";
    } else if (!set_colmap_camera(camera.model, camera.parameters, &one)) {
      throw InputError(
          path.string(),
          fmt::format("found {} parameters of camera {} ({}), which has another number",
                      camera.parameters.size(), camera.id, camera.model));
    }
    out.cameras.push_back(std::move(one));
  }
  return out;
}

/// sensor_id, name, sensor_type, [sensor_params]+: cameras among other sensors.
CalibrationFile kapture_calibration(const DelimitedLines& lines) {
  CalibrationFile out;
  out.form = "kapture sensors";
  for (const DelimitedLine& line : lines.lines()) {
    if (line.fields.size() < 4 || line.fields[2] != "camera") continue;
    const std::string model(line.fields[3]);
    CameraCalibration one;
    one.name = std::string(line.fields[0]);
    one.model = model;
    const bool known = colmap_forms().count(model) > 0;
    if (!known && model != "UNKNOWN_CAMERA") {
      lines.fail(line, 3,
                 fmt::format("found '{}', expected a camera model of COLMAP", printable(model)));
    }
    if (line.fields.size() < 6) {
      lines.fail(line, fmt::format("found {} fields of a camera, expected a width and a height",
                                   line.fields.size()));
    }
    one.width = lines.integer(line, 4, 1, 65535, "a width in pixels");
    one.height = lines.integer(line, 5, 1, 65535, "a height in pixels");
    std::vector<double> values;
    for (std::size_t i = 6; i < line.fields.size(); ++i) {
      if (!line.fields[i].empty()) values.push_back(lines.number(line, i, "a camera parameter"));
    }
    if (!known) {
      one.unsupported = "its intrinsics are not known";
    } else if (!set_colmap_camera(model, values, &one)) {
      lines.fail(line,
                 fmt::format("found {} parameters, which {} does not have", values.size(), model));
    }
    one.first_pixel = 0.5;
    out.cameras.push_back(std::move(one));
  }
  return out;
}

// ---- KITTI --------------------------------------------------------------------------------------

/// "P2", "P_rect_02": the projection of a rectified camera.
bool is_projection(const std::string& key) {
  return (key.size() == 2 && key[0] == 'P' && key[1] >= '0' && key[1] <= '9') ||
         key.rfind("P_rect_", 0) == 0;
}

bool is_kitti_key(const std::string& key) {
  static const std::set<std::string> others = {
      "R0_rect",        "R_rect",      "Tr_velo_to_cam", "Tr_velo_cam",
      "Tr_imu_to_velo", "Tr_imu_velo", "calib_time",     "Tr"};
  return is_projection(key) || key.rfind("K_0", 0) == 0 || key.rfind("S_0", 0) == 0 ||
         others.count(key) > 0;
}

struct KittiRow {
  const TextRow* row;
  std::vector<double> values;
};

void require_values(const TextRows& rows, const KittiRow& row, const std::string& key,
                    std::size_t count) {
  if (row.values.size() == count) return;
  rows.fail(*row.row,
            fmt::format("found {} numbers for {}, expected {}", row.values.size(), key, count));
}

CalibrationFile kitti_calibration(const TextRows& rows) {
  CalibrationFile out;
  out.form = "KITTI calibration";
  std::vector<std::pair<std::string, KittiRow>> order;
  std::map<std::string, KittiRow> by_key;
  for (const TextRow& row : rows.rows()) {
    std::string key(row.words[0].text);
    std::size_t first = 1;
    if (!key.empty() && key.back() == ':') key.pop_back();
    KittiRow read{&row, {}};
    bool numeric = true;
    for (std::size_t i = first; i < row.words.size() && numeric; ++i) {
      double value = 0.0;
      numeric = parse_number(row.words[i].text, &value) && std::isfinite(value);
      if (numeric) read.values.push_back(value);
    }
    const std::string kind = key.substr(0, 2);
    const bool wanted = is_projection(key) || kind == "K_" || kind == "D_" || kind == "S_";
    if (!numeric && wanted) {
      for (std::size_t i = first; i < row.words.size(); ++i) {
        rows.number(row, row.words[i], "a number");
      }
    }
    if (!numeric || read.values.empty()) continue;
    order.emplace_back(key, read);
    by_key[key] = read;
  }
  const auto set_size = [&](const std::string& key, CameraCalibration* camera) {
    const auto found = by_key.find(key);
    if (found == by_key.end()) return;
    require_values(rows, found->second, key, 2);
    camera->width = static_cast<int>(std::clamp(found->second.values[0], 0.0, 1e6));
    camera->height = static_cast<int>(std::clamp(found->second.values[1], 0.0, 1e6));
  };
  for (const auto& [key, row] : order) {
    CameraCalibration camera;
    camera.name = key;
    if (is_projection(key)) {
      require_values(rows, row, key, 12);
      const std::vector<double>& p = row.values;
      camera.model = "rectified pinhole";
      camera.projection = p;
      camera.fx = p[0];
      camera.fy = p[5];
      camera.cx = p[2];
      camera.cy = p[6];
      if (key.size() > 2) set_size("S_rect_" + key.substr(7), &camera);
      out.cameras.push_back(std::move(camera));
    } else if (key.rfind("K_", 0) == 0) {
      require_values(rows, row, key, 9);
      camera.model = "opencv";
      camera.fx = row.values[0];
      camera.fy = row.values[4];
      camera.cx = row.values[2];
      camera.cy = row.values[5];
      if (const auto d = by_key.find("D" + key.substr(1)); d != by_key.end()) {
        camera.coefficients = d->second.values;
      }
      set_opencv_lens(&camera, camera.coefficients);
      set_size("S" + key.substr(1), &camera);
      out.cameras.push_back(std::move(camera));
    } else {
      out.matrices[key] = row.values;
    }
  }
  return out;
}

// ---- ROS INI ------------------------------------------------------------------------------------

/// The next `count` numbers after a heading, over as many lines as they take.
std::vector<double> numbers_after(const TextRows& rows, const std::vector<const TextRow*>& lines,
                                  std::size_t* at, std::size_t least, const std::string& what) {
  std::vector<double> out;
  while (*at + 1 < lines.size()) {
    const TextRow& row = *lines[*at + 1];
    double ignored = 0.0;
    if (!parse_number(row.words[0].text, &ignored)) break;
    for (const TextWord& word : row.words) out.push_back(rows.number(row, word, "a number"));
    ++*at;
  }
  if (out.size() < least) {
    rows.fail(*lines[*at],
              fmt::format("found {} numbers for the {}, expected {}", out.size(), what, least));
  }
  return out;
}

CalibrationFile ini_calibration(const TextRows& rows) {
  std::vector<const TextRow*> lines;
  for (const TextRow& row : rows.rows()) {
    if (row.words[0].text[0] != '#' && row.words[0].text[0] != ';') lines.push_back(&row);
  }
  CalibrationFile out;
  out.form = "ROS camera_info";
  std::optional<int> width, height;
  CameraCalibration* camera = nullptr;
  const auto joined = [](const TextRow& row) {
    std::string text;
    for (const TextWord& word : row.words)
      text += (text.empty() ? "" : " ") + std::string(word.text);
    return text;
  };
  for (std::size_t at = 0; at < lines.size(); ++at) {
    const TextRow& row = *lines[at];
    const std::string text = joined(row);
    if (text.size() > 2 && text.front() == '[' && text.back() == ']') {
      const std::string name = text.substr(1, text.size() - 2);
      camera = nullptr;
      if (name == "image" || name == "externals") continue;
      out.cameras.emplace_back();
      camera = &out.cameras.back();
      camera->name = name;
    } else if (text == "width" || text == "height") {
      const double value = numbers_after(rows, lines, &at, 1, text)[0];
      (text == "width" ? width : height) = static_cast<int>(std::clamp(value, 0.0, 1e6));
    } else if (camera && text == "camera matrix") {
      const auto k = numbers_after(rows, lines, &at, 9, text);
      camera->fx = k[0];
      camera->fy = k[4];
      camera->cx = k[2];
      camera->cy = k[5];
    } else if (camera && text == "distortion") {
      camera->coefficients = numbers_after(rows, lines, &at, 0, text);
    } else if (camera && text == "projection") {
      camera->projection = numbers_after(rows, lines, &at, 12, text);
      camera->projection.resize(12);
    }
  }
  for (CameraCalibration& one : out.cameras) {
    one.width = width;
    one.height = height;
    one.model = one.coefficients.size() > 5 ? "rational_polynomial" : "plumb_bob";
    set_opencv_lens(&one, one.coefficients);
  }
  return out;
}

// ---- ZED ----------------------------------------------------------------------------------------

/// Pixels of a resolution as Stereolabs names it.
std::optional<std::pair<int, int>> zed_size(const std::string& word) {
  static const std::map<std::string, std::pair<int, int>> sizes = {
      {"2K", {2208, 1242}},      {"FHD", {1920, 1080}},    {"HD", {1280, 720}},
      {"VGA", {672, 376}},       {"SVGA", {960, 600}},     {"FHD1200", {1920, 1200}},
      {"HD1200", {1920, 1200}},  {"HD1080", {1920, 1080}}, {"4K", {3840, 2160}},
      {"QHDPLUS", {3200, 1800}}, {"HD720", {1280, 720}}};
  const auto at = sizes.find(word);
  return at == sizes.end() ? std::nullopt : std::make_optional(at->second);
}

/// SNnnnn.conf: sections [LEFT_CAM_HD] with fx=, fy=, cx=, cy=, k1= ...; nothing where there is
/// none.
std::optional<CalibrationFile> zed_calibration(const DelimitedLines& lines) {
  CalibrationFile out;
  out.form = "ZED";
  std::map<std::string, double> values;
  const DelimitedLine* section = nullptr;
  std::string name;
  const auto finish = [&] {
    if (!section) return;
    CameraCalibration camera;
    camera.name = name;
    const auto require = [&](const char* key) {
      const auto at = values.find(key);
      if (at == values.end())
        lines.fail(*section, fmt::format("found no {} of {}, expected it", key, printable(name)));
      return at->second;
    };
    camera.fx = require("fx");
    camera.fy = require("fy");
    camera.cx = require("cx");
    camera.cy = require("cy");
    if (const auto size = zed_size(name.substr(name.rfind('_') + 1))) {
      camera.width = size->first;
      camera.height = size->second;
    }
    camera.model = "opencv";
    for (const char* const key : {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}) {
      camera.coefficients.push_back(values.count(key) ? values[key] : 0.0);
    }
    set_opencv_lens(&camera, camera.coefficients);
    out.cameras.push_back(std::move(camera));
  };
  for (const DelimitedLine& line : lines.lines()) {
    const std::string first(line.fields[0]);
    if (first.size() > 2 && first.front() == '[' && first.back() == ']') {
      finish();
      name = first.substr(1, first.size() - 2);
      values.clear();
      section = name.find("_CAM_") != std::string::npos ? &line : nullptr;
    } else if (section && line.fields.size() == 2) {
      values[first] = lines.number(line, 1, "a number");
    }
  }
  finish();
  if (out.cameras.empty()) return std::nullopt;
  return out;
}

// ---- a matrix alone -----------------------------------------------------------------------------

/// A 3 x 3 matrix in brackets, as JSON, numpy or MATLAB print one, perhaps behind a name and
/// "array(".
std::optional<CalibrationFile> bracketed_matrix(const std::string& text) {
  constexpr std::size_t kLongest = 4000;
  constexpr std::size_t kLongestAround = 80;  // expressions with several runs of blanks are slow
  const std::size_t open = text.find('['), close = text.rfind(']');
  if (open == std::string::npos || close == std::string::npos || close < open ||
      text.size() > kLongest) {
    return std::nullopt;
  }
  static const std::regex before(
      R"(^(\xEF\xBB\xBF)?\s*([A-Za-z_]\w*\s*[=:]\s*)?((np|numpy)\.)?(array|matrix|mat)?\s*\(?\s*$)");
  static const std::regex behind(R"(^\s*(,\s*dtype\s*=\s*[\w.]+\s*)?\)?\s*;?\s*$)");
  if (open > kLongestAround || text.size() - close - 1 > kLongestAround) return std::nullopt;
  if (!std::regex_match(text.substr(0, open), before) ||
      !std::regex_match(text.substr(close + 1), behind)) {
    return std::nullopt;
  }
  std::vector<double> k;
  std::string word;
  for (std::size_t i = open; i <= close; ++i) {
    const bool separates = std::string("[](),; \t\r\n").find(text[i]) != std::string::npos;
    if (!separates) {
      word += text[i];
      continue;
    }
    if (word.empty()) continue;
    double value = 0.0;
    if (word.size() > 1 && word.back() == '.') word += '0';  // numpy's "910."
    if (k.size() >= 9 || !parse_number(word, &value) || !std::isfinite(value)) return std::nullopt;
    k.push_back(value);
    word.clear();
  }
  if (k.size() != 9 || k[6] != 0.0 || k[7] != 0.0 || k[8] != 1.0 || k[3] != 0.0)
    return std::nullopt;
  CameraCalibration camera;
  camera.model = "opencv";
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2];
  camera.cy = k[5];
  set_skew(&camera, k[1]);
  CalibrationFile out;
  out.form = "camera matrix";
  out.cameras.push_back(std::move(camera));
  return out;
}

/// Nine numbers, row by row, and nothing else.
std::optional<CalibrationFile> bare_matrix(const TextRows& rows) {
  std::vector<double> k;
  for (const TextRow& row : rows.rows()) {
    for (const TextWord& word : row.words) {
      double value = 0.0;
      if (k.size() >= 9 || !parse_number(word.text, &value)) return std::nullopt;
      k.push_back(value);
    }
  }
  if (k.size() != 9 || k[6] != 0.0 || k[7] != 0.0 || k[8] != 1.0) return std::nullopt;
  CameraCalibration camera;
  camera.model = "opencv";
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2];
  camera.cy = k[5];
  CalibrationFile out;
  out.form = "camera matrix";
  out.cameras.push_back(std::move(camera));
  return out;
}

}  // namespace

std::optional<CalibrationFile> calibration_of_text(const fs::path& path, const std::string& text) {
  if (path.extension() == ".bin") return colmap_calibration(path, text);
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string::npos)
    throw InputError(path.string(), "found an empty file, expected a calibration");
  if (text[first] == '<' || text[first] == '{' || text.compare(first, 5, "%YAML") == 0)
    return std::nullopt;
  if (const auto matrix = bracketed_matrix(text)) return matrix;
  const TextRows rows(path);
  const TextRow* content = nullptr;  // the first line that is no comment
  bool ini = false, kapture = text.compare(first, 16, "# kapture format") == 0;
  for (const TextRow& row : rows.rows()) {
    const std::string_view word = row.words[0].text;
    if (word == "[image]") ini = true;
    if (!content && word[0] != '#' && word[0] != ';') content = &row;
  }
  if (ini) return ini_calibration(rows);
  if (text[first] == '[' && text.find("_CAM_") != std::string::npos) {
    const DelimitedLines lines(path, '=');
    if (auto zed = zed_calibration(lines)) return zed;
  }
  if (kapture) return kapture_calibration(DelimitedLines(path, ','));
  if (!content) return std::nullopt;
  if (content->words.size() >= 2 && colmap_forms().count(std::string(content->words[1].text))) {
    return colmap_calibration(path, text);
  }
  // A table of cameras of an unknown model is COLMAP's all the same.
  if (text.compare(first, 17, "# Camera list wit") == 0) return colmap_calibration(path, text);
  std::string key(content->words[0].text);
  if (!key.empty() && key.back() == ':') key.pop_back();
  if (is_kitti_key(key)) return kitti_calibration(rows);
  return bare_matrix(rows);
}

}  // namespace camber
