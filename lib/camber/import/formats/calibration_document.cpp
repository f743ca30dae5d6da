#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"

namespace camber {
namespace {

using Names = std::vector<std::string>;

constexpr int kMaxSide = 65535;

// Names in use, as plain_name() writes them.
const Names kMatrixNames = {"cameramatrix",
                            "k",
                            "intrinsicmatrix",
                            "cameraintrinsic",
                            "intrinsics",
                            "intrinsic",
                            "mtx",
                            "cameraintrinsics",
                            "matrix",
                            "cammatrix",
                            "kmatrix",
                            "intrinsicparameters",
                            "cameramat",
                            "intrinsicmat",
                            "intrinsicsmatrix"};
const Names kDistortionNames = {"distortioncoefficients",
                                "distortioncoeffs",
                                "distcoeffs",
                                "distcoeff",
                                "distcoefs",
                                "d",
                                "distortion",
                                "dist",
                                "distortionparameters",
                                "distortionparams",
                                "distortionmatrix",
                                "distortioncoefs",
                                "distortionvector",
                                "distcoefficients",
                                "coeffs"};
const Names kModelNames = {"distortionmodel", "distortiontype"};
const Names kProjectionNames = {"projectionmatrix", "projection", "p"};
const Names kSizeNames = {"imagesize",       "resolution",  "size",          "imgsize",
                          "imageresolution", "imagesizewh", "imagedimension"};
const Names kWidthNames = {"imagewidth", "width", "imgwidth", "framewidth", "w"};
const Names kHeightNames = {"imageheight", "height", "imgheight", "frameheight", "h"};
const Names kFxNames = {"fx", "focalx", "focallengthx"},
            kFyNames = {"fy", "focaly", "focallengthy"};
const Names kCxNames = {"cx", "u0", "ppx", "principalpointx"};
const Names kCyNames = {"cy", "v0", "ppy", "principalpointy"};

Names with(const std::string& prefix, Names names, const std::string& suffix = "") {
  for (std::string& name : names) name = prefix + name + suffix;
  return names;
}

/// Reads cameras of one document; the helpers know where its errors are.
class DocumentReader {
 public:
  explicit DocumentReader(const Document& document) : d_(document) {}

  std::optional<CalibrationFile> read() {
    const YAML::Node& root = d_.root();
    CalibrationFile out;
    if (root.IsSequence()) {
      out = sensor_table(root);
    } else if (root.IsMap()) {
      const auto first = find_by_plain_name(root, {"value0"});
      if (first && find_by_plain_name(*first, {"intrinsics"})) {
        out = basalt(*first);
      } else if (is_opensfm(root)) {
        out = opensfm(root);
      } else if (find_by_plain_name(root, {"modeltype"})) {
        out = camodocal(root);
      } else if (is_nerfstudio(root)) {
        out = nerfstudio(root);
      } else if (find(root, {"cameradata"})) {
        out = argoverse(root);
      } else if (find(root, {"cammodel"}) && find(root, {"camwidth"})) {
        out = vikit(root);
      } else if (is_orb_slam(root)) {
        out = orb_slam(root);
      } else {
        out = by_names(root);
      }
    }
    if (out.cameras.empty()) return std::nullopt;
    return out;
  }

 private:
  std::optional<YAML::Node> find(const YAML::Node& map, const Names& names) const {
    return find_by_plain_name(map, names);
  }
  double require(const YAML::Node& map, const Names& names, const std::string& what) const {
    const auto found = find(map, names);
    if (!found)
      d_.fail(map, fmt::format("found no {}, expected it beside the others of the camera", what));
    return d_.number(*found, what);
  }
  int side(const YAML::Node& node) const {
    return d_.integer(node, 1, kMaxSide, "a number of pixels from 1 to 65535");
  }

  void set_size(const YAML::Node& map, CameraCalibration* camera, const std::string& prefix = "",
                const std::string& suffix = "") const {
    const auto width = find(map, with(prefix, kWidthNames, suffix));
    const auto height = find(map, with(prefix, kHeightNames, suffix));
    // 0 stands for "not known" in some files.
    if (width && height && text_of(*width) != "0") {
      camera->width = side(*width);
      camera->height = side(*height);
      return;
    }
    const auto size = find(map, with(prefix, kSizeNames, suffix));
    if (!size) return;
    if (size->IsMap()) {
      set_size(*size, camera);
    } else if (size->IsSequence() && size->size() == 2) {
      camera->width = side((*size)[0]);
      camera->height = side((*size)[1]);
    }
  }

  /// k1 k2 p1 p2 k3 k4 k5 k6 as far as a map names them; for the equidistant model k1 k2 k3 k4.
  std::vector<double> named_coefficients(const YAML::Node& map, const std::string& prefix = "",
                                         bool fisheye = false) const {
    const Names order = fisheye ? Names{"k1", "k2", "k3", "k4"}
                                : Names{"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
    std::vector<double> out;
    std::size_t used = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const auto found = find(map, {prefix + order[i]});
      out.push_back(found ? d_.number(*found, "a distortion coefficient") : 0.0);
      if (found) used = i + 1;
    }
    out.resize(used);
    return out;
  }

  /// fx, fy, cx, cy by name, with "focal" alone for both.
  bool set_named_intrinsics(const YAML::Node& map, CameraCalibration* camera) const {
    if (!map.IsMap()) return false;
    const auto one = find(map, {"f", "focal", "focallength"});
    const auto fx = find(map, kFxNames);
    const auto point = find(map, {"principalpoint"});
    if (one && one->IsSequence() && one->size() == 2 && point && point->IsSequence() &&
        point->size() == 2) {  // OKVIS
      camera->fx = d_.number((*one)[0], "a focal length in pixels");
      camera->fy = d_.number((*one)[1], "a focal length in pixels");
      camera->cx = d_.number((*point)[0], "a principal point in pixels");
      camera->cy = d_.number((*point)[1], "a principal point in pixels");
      return true;
    }
    if ((!fx && !(one && one->IsScalar())) || !find(map, kCxNames)) return false;
    camera->fx = d_.number(fx ? *fx : *one, "a focal length in pixels");
    camera->fy = fx ? require(map, kFyNames, "fy") : camera->fx;
    camera->cx = require(map, kCxNames, "cx");
    camera->cy = require(map, kCyNames, "cy");
    return true;
  }

  void set_matrix(const YAML::Node& node, CameraCalibration* camera) const {
    const char* expectation = "a 3 x 3 camera matrix, or fx fy cx cy";
    const std::vector<double> k = d_.numbers(node, expectation);
    if (k.size() == 4) {
      std::tie(camera->fx, camera->fy, camera->cx, camera->cy) = std::tie(k[0], k[1], k[2], k[3]);
      return;
    }
    if (k.size() == 5 || k.size() == 6) {  // Kalibr's omni (xi first), ds and eucm
      camera->unsupported = fmt::format("it has {} intrinsics, a pinhole camera's are 4", k.size());
      return;
    }
    if (k.size() != 9 && k.size() != 12) {
      d_.fail(node, fmt::format("found {} numbers, expected {}", k.size(), expectation));
    }
    const std::size_t row = k.size() / 3;
    const bool by_columns =
        k.size() == 9 && k[2] == 0.0 && k[5] == 0.0 && k[8] == 1.0 && k[6] != 0.0;
    camera->fx = k[0];
    camera->fy = k[row + 1];
    camera->cx = by_columns ? k[6] : k[2];
    camera->cy = by_columns ? k[7] : k[row + 2];
    if (!by_columns) set_skew(camera, k[1]);
  }

  static bool holds_matrix(const YAML::Node& node) {
    if (node.IsSequence()) return true;
    return node.IsMap() && find_by_plain_name(node, {"data"}).has_value();
  }

  /// A camera from one object of values, where it has a camera matrix or focal lengths.
  std::optional<CameraCalibration> camera_of(const YAML::Node& map,
                                             const std::string& suffix = "") const {
    CameraCalibration out;
    const auto matrix = find(map, with("", kMatrixNames, suffix));
    if (matrix && holds_matrix(*matrix)) {
      set_matrix(*matrix, &out);
    } else if (!(matrix && set_named_intrinsics(*matrix, &out)) &&
               !(suffix.empty() && set_named_intrinsics(map, &out))) {
      return std::nullopt;
    }
    set_size(map, &out, "", suffix);
    if (!out.width) set_size(map, &out);
    if (matrix && matrix->IsMap() && !out.width) set_size(*matrix, &out);
    if (const auto name = find(map, {"cameraname", "camname"})) out.name = text_of(*name);
    set_distortion(map, matrix.value_or(YAML::Node()), suffix, &out);
    if (const auto p = find(map, kProjectionNames); p && suffix.empty()) {
      out.projection = d_.numbers(*p, "a 3 x 4 projection matrix");
      if (out.projection.size() != 12) {
        d_.fail(*p, fmt::format("found {} numbers, expected the 12 of a projection matrix",
                                out.projection.size()));
      }
      if (std::all_of(out.projection.begin(), out.projection.end(),
                      [](double v) { return v == 0; })) {
        out.projection.clear();
      }
    }
    if (const auto t = find(map, {"tcamimu"})) out.camera_from_imu = transform(*t);
    set_sigmas(map, &out.sigma);
    return out;
  }

  /// Whether a value is coefficients other than zeros: numbers, a list of some, a map of some.
  static bool holds_coefficients(const YAML::Node& node, int depth = 0) {
    if (node.IsScalar()) {
      try {
        return node.as<double>() != 0.0;
      } catch (const YAML::Exception&) {
        return false;
      }
    }
    if (depth > 2 || !(node.IsSequence() || node.IsMap())) return false;
    for (const auto& entry : node) {
      if (holds_coefficients(node.IsMap() ? entry.second : entry, depth + 1)) return true;
    }
    return false;
  }

  static void collect(const YAML::Node& node, std::vector<double>* numbers) {
    if (node.IsScalar()) {
      try {
        numbers->push_back(node.as<double>());
      } catch (const YAML::Exception&) {
        numbers->push_back(std::numeric_limits<double>::quiet_NaN());
      }
    } else if (node.IsSequence()) {
      for (const auto& entry : node) collect(entry, numbers);
    }
  }

  /// Whether a list is like OpenCV's coefficients: as many, small, of both signs. Neither rotations
  /// (quaternions have norm 1) nor errors (positive) are.
  static bool like_coefficients(const YAML::Node& node) {
    if (!node.IsSequence()) return false;
    std::vector<double> numbers;
    collect(node, &numbers);
    const std::size_t n = numbers.size();
    if (n != 4 && n != 5 && n != 8 && n != 14) return false;
    double squares = 0.0;
    bool above = false, below = false;
    for (const double value : numbers) {
      if (!(std::abs(value) < 10.0)) return false;
      squares += value * value;
      above = above || value > 0.0;
      below = below || value < 0.0;
    }
    return above && below && !(n == 4 && std::abs(squares - 1.0) < 1e-3);
  }

  /// A key that is not known, holds numbers and is called as coefficients of a lens are, or has a
  /// name that says nothing and numbers like theirs; "" if none.
  static std::string unknown_coefficients(const YAML::Node& map) {
    if (!map.IsMap()) return "";
    static const Names kOthers = {"pos", "rot",     "quat", "trans", "extrinsic", "euler",
                                  "imu", "gravity", "box",  "roi",   "bounds",    "noise"};
    for (const auto& entry : map) {
      const std::string name = plain_name(text_of(entry.first));
      if (name.find("sigma") != std::string::npos) continue;  // how well they are known
      const bool alike =
          name.find("distor") != std::string::npos || name.find("radial") != std::string::npos ||
          name.find("tangential") != std::string::npos || name.find("coef") != std::string::npos ||
          (name.rfind("dist", 0) == 0 && name.find("distance") == std::string::npos);
      if (alike && holds_coefficients(entry.second)) return text_of(entry.first);
      const bool other = std::any_of(kOthers.begin(), kOthers.end(), [&](const std::string& word) {
        return name.find(word) != std::string::npos;
      });
      const auto known = [&](const Names& names) {
        return std::find(names.begin(), names.end(), name) != names.end();
      };
      if (!other && !known(kMatrixNames) && !known(kProjectionNames) && !known(kSizeNames) &&
          like_coefficients(entry.second)) {
        return text_of(entry.first);
      }
    }
    return "";
  }

  /// No coefficients were found: fails where the file has some all the same, by the model that it
  /// names or by a key that is not known.
  /// @param word  the model; empty: none is named
  void require_no_lens(const YAML::Node& map, const YAML::Node& intrinsics,
                       const std::string& word) const {
    std::string key = unknown_coefficients(map);
    if (key.empty() && intrinsics.IsMap()) key = unknown_coefficients(intrinsics);
    if (!key.empty()) {
      d_.fail(map, fmt::format("found '{}', which is no name known for the coefficients of a lens, "
                               "expected distortion_coefficients (or dist_coeffs, D, k1 ...)",
                               printable(key)));
    }
    const std::string model = plain_name(word);
    if (!model.empty() && model != "none" && model != "pinhole" && model != "null" &&
        model != "0" && model != "perspective" && model != "rectified") {
      d_.fail(map, fmt::format("found the lens model '{}' without its coefficients, expected "
                               "distortion_coefficients beside it (of zeros for no distortion)",
                               printable(word)));
    }
  }

  /// What a calibration of Camber's own has beside OpenCV's keys.
  void set_sigmas(const YAML::Node& map, CameraSigma* sigma) const {
    const auto read = [&](const char* name, const char* what, double most, double* to) {
      const auto found = find(map, {name});
      if (!found) return;
      *to = d_.number(*found, what);
      if (*to >= 0.0 && *to <= most) return;
      d_.fail(*found, fmt::format("found {}, expected {} from 0 to {}", *to, what, most));
    };
    read("focalsigma", "a share of the focal length", 1.0, &sigma->focal);
    read("principalsigma", "a number of pixels", kMaxSide, &sigma->principal);
    read("distortionsigma", "a standard deviation of k1", 10.0, &sigma->distortion);
  }

  void set_distortion(const YAML::Node& map, const YAML::Node& intrinsics,
                      const std::string& suffix, CameraCalibration* out) const {
    std::string word;
    if (const auto model = find(map, kModelNames)) word = text_of(*model);
    const auto camera_model = find(map, {"cameramodel"});
    const bool omni = camera_model && plain_name(text_of(*camera_model)) != "pinhole";
    if (omni) word = text_of(*camera_model);
    const auto flag = find(map, {"fisheyemodel"});
    const bool fisheye_flag = flag && text_of(*flag) != "0" && text_of(*flag) != "false";
    const auto given = find(map, with("", kDistortionNames, suffix));
    const bool listed = given && !given->IsScalar() && !given->IsNull();
    if (given && given->IsMap() && !find(*given, {"data"})) {
      if (const auto model = find(*given, {"model", "type"})) word = text_of(*model);
      const auto values = find(*given, {"coefficients", "parameters", "coeffs"});
      out->coefficients =
          values ? d_.numbers(*values, "distortion coefficients") : named_coefficients(*given);
      if (!values && out->coefficients.empty()) require_no_lens(map, *given, word);
    } else if (listed) {
      out->coefficients = d_.numbers(*given, "distortion coefficients");
    } else {
      out->coefficients = named_coefficients(map);
      if (out->coefficients.empty() && intrinsics.IsMap()) {
        out->coefficients = named_coefficients(intrinsics);
      }
      if (out->coefficients.empty() && !omni) require_no_lens(map, intrinsics, word);
    }
    out->model = word.empty() ? (fisheye_flag ? "fisheye" : "opencv") : word;
    if (omni || out->unsupported.empty()) set_lens_by_word(out, out->model, out->coefficients);
    if (camera_model && !word.empty() && !omni) out->model = "pinhole-" + word;
  }

  Eigen::Matrix4d transform(const YAML::Node& node) const {
    const std::vector<double> v = d_.numbers(node, "a 4 x 4 transform");
    if (v.size() != 16 && v.size() != 12) {
      d_.fail(node, fmt::format("found {} numbers, expected a 4 x 4 transform", v.size()));
    }
    Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
    for (std::size_t i = 0; i < v.size(); ++i)
      out(static_cast<int>(i / 4), static_cast<int>(i % 4)) = v[i];
    return out;
  }

  // ---- one object, a stereo pair, or objects by camera name -----------------------------------

  CalibrationFile by_names(const YAML::Node& root) const {
    CalibrationFile out;
    if (const auto one = camera_of(root)) {
      out.form = find(root, kModelNames) ? "ROS camera_info" : "OpenCV";
      if (const std::string which = which_matrix(root); !which.empty()) out.form += ", " + which;
      out.cameras.push_back(*one);
      return out;
    }
    for (const std::string suffix : {"1", "2", "left", "right", "l", "r"}) {
      const auto matrix =
          find(root, {"cameramatrix" + suffix, "k" + suffix, "m" + suffix, "mtx" + suffix});
      if (!matrix || !holds_matrix(*matrix)) continue;  // k1 may be a coefficient
      out.form = "OpenCV stereo";
      out.cameras.push_back(stereo_camera(root, suffix));
    }
    if (out.cameras.empty()) nested(root, 0, &out);
    return out;
  }

  /// Of several camera matrices in a file (of the raw and the undistorted image), the one that
  /// counts.
  std::string which_matrix(const YAML::Node& map) const {
    std::string taken, others;
    const auto matrix = find(map, kMatrixNames);
    for (const auto& entry : map) {
      const YAML::Node& value = entry.second;
      if (!entry.first.IsScalar() || !holds_matrix(value)) continue;
      const YAML::Node data = value.IsMap() ? *find(value, {"data"}) : value;
      if (!data.IsSequence() || data.size() > 9) continue;
      std::vector<double> k;
      for (const YAML::Node& row : data) {
        if (row.IsSequence()) {
          for (const YAML::Node& item : row) k.push_back(item.as<double>(0.0));
        } else {
          k.push_back(row.as<double>(0.0));
        }
      }
      if (k.size() != 9 || !(k[0] > 1.0 && k[4] > 1.0) || k[3] != 0.0 || k[8] != 1.0) continue;
      const std::string name = printable(text_of(entry.first), 64);
      if (matrix && value.is(*matrix)) {
        taken = name;
      } else {
        others += (others.empty() ? "" : ", ") + name;
      }
    }
    if (taken.empty() || others.empty()) return "";
    return fmt::format("the camera of '{}', not of {}", taken, others);
  }

  CameraCalibration stereo_camera(const YAML::Node& root, const std::string& suffix) const {
    CameraCalibration out;
    const auto matrix =
        find(root, {"cameramatrix" + suffix, "k" + suffix, "m" + suffix, "mtx" + suffix});
    set_matrix(*matrix, &out);
    set_size(root, &out, "", suffix);
    if (!out.width) set_size(root, &out);
    out.name = suffix;
    set_distortion(root, YAML::Node(), suffix, &out);
    return out;
  }

  void nested(const YAML::Node& map, int depth, CalibrationFile* out) const {
    if (depth > 3 || !map.IsMap()) return;
    for (const auto& entry : map) {
      if (entry.second.IsSequence()) listed(entry.second, depth + 1, out);
      if (!entry.second.IsMap() || out->cameras.size() > 256) continue;
      const std::string name = text_of(entry.first);
      auto camera = camera_of(entry.second);
      if (camera) {
        const auto inner = find(entry.second, {"intrinsic", "intrinsics"});
        // Its distortion may stand inside too: {"intrinsic": {"K": [], "D": []}}.
        if (inner && inner->IsMap() && camera->coefficients.empty()) {
          if (auto full = camera_of(*inner)) camera = std::move(full);
        }
        if (camera->name.empty()) camera->name = name;
        out->form = find(entry.second, {"tcamimu", "cameramodel"}) ? "Kalibr" : "cameras by name";
        out->cameras.push_back(std::move(*camera));
        continue;
      }
      const std::size_t before = out->cameras.size();
      nested(entry.second, depth + 1, out);
      if (out->cameras.size() != before + 1) continue;
      const std::string inner = plain_name(out->cameras.back().name);
      if (inner == "intrinsic" || inner == "intrinsics" || inner == "calibration") {
        out->cameras.back().name = name;
      }
    }
  }

  /// Cameras in a list, by their names or places: OKVIS, Kalibr's rigs of SVO.
  void listed(const YAML::Node& list, int depth, CalibrationFile* out) const {
    for (std::size_t i = 0; i < list.size() && out->cameras.size() <= 256; ++i) {
      if (!list[i].IsMap()) return;
      auto camera = camera_of(list[i]);
      const std::size_t before = out->cameras.size();
      if (camera) {
        out->form = find(list[i], {"tsc"}) ? "OKVIS" : "list of cameras";
        out->cameras.push_back(std::move(*camera));
      } else {
        nested(list[i], depth + 1, out);
      }
      if (out->cameras.size() != before + 1) continue;
      const auto name = find(list[i], {"name", "cameraname", "label", "key"});
      if (name && name->IsScalar()) {
        out->cameras.back().name = text_of(*name);
      } else if (camera && out->cameras.back().name.empty()) {
        out->cameras.back().name = std::to_string(i);
      }
    }
  }

  // ---- programs with forms of their own --------------------------------------------------------

  /// nuScenes and Lyft: calibrated_sensor.json, a list of sensors, lidars without intrinsics.
  CalibrationFile sensor_table(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "nuScenes calibrated_sensor";
    for (const YAML::Node& sensor : root) {
      const auto matrix = find(sensor, {"cameraintrinsic"});
      if (!matrix) continue;
      if (!matrix->IsSequence()) d_.expected(*matrix, "a 3 x 3 camera matrix or an empty list");
      if (matrix->size() == 0) continue;
      CameraCalibration camera;
      camera.model = "pinhole";
      set_matrix(*matrix, &camera);
      if (const auto token = find(sensor, {"token", "channel", "name"}))
        camera.name = text_of(*token);
      if (const auto q = find(sensor, {"rotation"})) {
        const auto v = d_.numbers(*q, "4 numbers w x y z");
        if (v.size() != 4)
          d_.fail(*q, fmt::format("found {} numbers, expected 4 w x y z", v.size()));
        camera.rotation_wxyz = Eigen::Vector4d(v[0], v[1], v[2], v[3]);
      }
      if (const auto t = find(sensor, {"translation"})) {
        const auto v = d_.numbers(*t, "3 numbers x y z");
        if (v.size() != 3) d_.fail(*t, fmt::format("found {} numbers, expected 3 x y z", v.size()));
        camera.translation = Eigen::Vector3d(v[0], v[1], v[2]);
      }
      out.cameras.push_back(std::move(camera));
    }
    return out;
  }

  CalibrationFile basalt(const YAML::Node& value) const {
    CalibrationFile out;
    out.form = "Basalt";
    const auto sizes = find(value, {"resolution"});
    const YAML::Node list = *find(value, {"intrinsics"});
    if (!list.IsSequence()) d_.expected(list, "a list of cameras");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const YAML::Node entry = list[i];
      const auto intrinsics = find(entry, {"intrinsics"});
      CameraCalibration camera;
      camera.name = std::to_string(i);
      if (const auto type = find(entry, {"cameratype"})) camera.model = text_of(*type);
      if (!intrinsics || !set_named_intrinsics(*intrinsics, &camera)) {
        d_.expected(entry, "intrinsics with fx, fy, cx and cy");
      }
      const bool kannala = plain_name(camera.model) == "kb4";
      for (const auto& parameter : *intrinsics) {
        const std::string name = text_of(parameter.first);
        if (name == "fx" || name == "fy" || name == "cx" || name == "cy" || name == "rpmax")
          continue;
        camera.coefficients.push_back(d_.number(parameter.second, "a camera parameter"));
      }
      set_lens_by_word(&camera, camera.model,
                       kannala ? camera.coefficients : named_coefficients(*intrinsics));
      if (sizes && sizes->IsSequence() && i < sizes->size() && (*sizes)[i].IsSequence() &&
          (*sizes)[i].size() == 2) {
        camera.width = side((*sizes)[i][0]);
        camera.height = side((*sizes)[i][1]);
      }
      out.cameras.push_back(std::move(camera));
    }
    return out;
  }

  static bool is_opensfm(const YAML::Node& root) {
    for (const auto& entry : root) {
      if (entry.second.IsMap() && find_by_plain_name(entry.second, {"projectiontype"})) return true;
    }
    return false;
  }

  /// camera_models.json: lengths as a share of the longer side, from the middle of the image.
  CalibrationFile opensfm(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "OpenSfM";
    for (const auto& entry : root) {
      const YAML::Node& c = entry.second;
      const auto type = find(c, {"projectiontype"});
      if (!type) continue;
      CameraCalibration camera;
      camera.name = text_of(entry.first);
      camera.model = "opensfm " + text_of(*type);
      set_size(c, &camera);
      if (!camera.width) d_.expected(c, "a camera with a width and a height");
      const double side = std::max(*camera.width, *camera.height);
      const auto share = [&](const Names& names, double absent) {
        const auto found = find(c, names);
        return found ? d_.number(*found) : absent;
      };
      const double focal = share({"focal", "focalx"}, 0.0);
      camera.fx = focal * side;
      camera.fy = share({"focaly"}, focal) * side;
      camera.cx = 0.5 * (*camera.width - 1) + share({"cx"}, 0.0) * side;
      camera.cy = 0.5 * (*camera.height - 1) + share({"cy"}, 0.0) * side;
      const std::string word = plain_name(text_of(*type));
      const bool fisheye = word == "fisheye" || word == "fisheyeopencv";
      camera.coefficients = named_coefficients(c, "", fisheye);
      const bool radial =
          word == "perspective" || word == "brown" || word == "simpleradial" || word == "radial";
      if (radial) {
        set_opencv_lens(&camera, camera.coefficients);
      } else if (fisheye) {
        set_fisheye_lens(&camera, camera.coefficients);
      } else {
        camera.unsupported =
            "its projection \"" + printable(text_of(*type)) + "\" is not supported";
      }
      out.cameras.push_back(std::move(camera));
    }
    return out;
  }

  /// camodocal, as VINS takes it.
  CalibrationFile camodocal(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "camodocal";
    CameraCalibration camera;
    const std::string type = text_of(*find(root, {"modeltype"}));
    if (const auto name = find(root, {"cameraname"})) camera.name = text_of(*name);
    set_size(root, &camera);
    const auto projection = find(root, {"projectionparameters"});
    if (type == "KANNALA_BRANDT") {
      if (!projection) d_.expected(root, "projection_parameters");
      camera.model = type;
      camera.fx = require(*projection, {"mu"}, "mu");
      camera.fy = require(*projection, {"mv"}, "mv");
      camera.cx = require(*projection, {"u0"}, "u0");
      camera.cy = require(*projection, {"v0"}, "v0");
      for (const char* k : {"k2", "k3", "k4", "k5"})
        camera.coefficients.push_back(require(*projection, {k}, k));
      set_fisheye_lens(&camera, camera.coefficients);
    } else if (type == "PINHOLE" || type == "PINHOLE_FULL") {
      if (!projection || !set_named_intrinsics(*projection, &camera)) {
        d_.expected(root, "projection_parameters with fx, fy, cx and cy");
      }
      camera.model = "opencv";
      const auto distortion = find(root, {"distortionparameters"});
      if (distortion) camera.coefficients = named_coefficients(*distortion);
      if (camera.coefficients.empty() && !distortion) require_no_lens(root, *projection, "");
      set_opencv_lens(&camera, camera.coefficients);
    } else {
      camera.model = type;
      camera.unsupported = "its camera model \"" + printable(type) + "\" is not supported";
    }
    out.cameras.push_back(std::move(camera));
    return out;
  }

  static bool is_nerfstudio(const YAML::Node& root) {
    if (find_by_plain_name(root, {"flx", "cameraanglex"})) return true;
    const auto frames = find_by_plain_name(root, {"frames"});
    return frames && frames->IsSequence() && frames->size() > 0 &&
           find_by_plain_name((*frames)[0], {"flx"}).has_value();
  }

  /// transforms.json of nerfstudio and instant-ngp: one camera, or one for each frame.
  CalibrationFile nerfstudio(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "nerfstudio";
    if (!find(root, {"flx", "cameraanglex"})) {
      const YAML::Node frames = *find(root, {"frames"});
      for (const YAML::Node& frame : frames) {
        CameraCalibration camera = nerfstudio_camera(frame, root);
        if (const auto path = find(frame, {"filepath"})) camera.name = text_of(*path);
        const auto same = [&](const CameraCalibration& other) {
          return other.fx == camera.fx && other.fy == camera.fy && other.cx == camera.cx &&
                 other.cy == camera.cy && other.lens_coefficients == camera.lens_coefficients;
        };
        if (std::none_of(out.cameras.begin(), out.cameras.end(), same))
          out.cameras.push_back(std::move(camera));
      }
      return out;
    }
    out.cameras.push_back(nerfstudio_camera(root, root));
    return out;
  }

  CameraCalibration nerfstudio_camera(const YAML::Node& map, const YAML::Node& root) const {
    CameraCalibration out;
    set_size(map, &out);
    if (!out.width) set_size(root, &out);
    out.first_pixel = 0.5;  // as COLMAP, which most of them come from
    const auto angle = find(map, {"cameraanglex"});
    if (const auto fx = find(map, {"flx"})) {
      out.fx = d_.number(*fx, "a focal length in pixels");
    } else {
      if (!out.width) d_.expected(map, "fl_x, or camera_angle_x with w and h");
      out.fx = 0.5 * *out.width / std::tan(0.5 * d_.number(*angle, "an angle in radians"));
    }
    const auto fy = find(map, {"fly"});
    out.fy = fy ? d_.number(*fy, "a focal length in pixels") : out.fx;
    const auto cx = find(map, {"cx"}), cy = find(map, {"cy"});
    if (!(cx && cy) && !out.width) d_.expected(map, "cx and cy, or w and h");
    out.cx = cx ? d_.number(*cx, "cx in pixels") : 0.5 * *out.width;
    out.cy = cy ? d_.number(*cy, "cy in pixels") : 0.5 * *out.height;
    auto model = find(map, {"cameramodel"});
    if (!model) model = find(root, {"cameramodel"});
    const auto flag = find(map, {"isfisheye"});
    std::string word = model ? text_of(*model) : "OPENCV";
    if (flag && (text_of(*flag) == "true" || text_of(*flag) == "1")) word = "OPENCV_FISHEYE";
    out.model = word;
    const std::string plain = plain_name(word);
    const bool fisheye = plain.find("fisheye") != std::string::npos;
    out.coefficients = named_coefficients(map, "", fisheye);
    const bool opencv = plain == "simplepinhole" || plain == "simpleradial" || plain == "radial" ||
                        plain == "fullopencv";
    set_lens_by_word(&out, opencv ? "opencv" : word, out.coefficients);
    return out;
  }

  /// Argoverse 1: cameras of a log with k1 k2 k3 and their mounting.
  CalibrationFile argoverse(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "Argoverse";
    const YAML::Node list = *find(root, {"cameradata"});
    if (!list.IsSequence()) d_.expected(list, "a list of cameras");
    for (const YAML::Node& entry : list) {
      const auto value = find(entry, {"value"});
      if (!value || !value->IsMap()) d_.expected(entry, "a camera {\"key\", \"value\"}");
      CameraCalibration camera;
      if (const auto key = find(entry, {"key"})) {
        camera.name = text_of(*key);
        const std::string prefix = "image_raw_";
        if (camera.name.rfind(prefix, 0) == 0) camera.name.erase(0, prefix.size());
      }
      camera.fx = require(*value, {"focallengthxpx"}, "focal_length_x_px_");
      camera.fy = require(*value, {"focallengthypx"}, "focal_length_y_px_");
      camera.cx = require(*value, {"focalcenterxpx"}, "focal_center_x_px_");
      camera.cy = require(*value, {"focalcenterypx"}, "focal_center_y_px_");
      camera.model = "k1 k2 k3";
      if (const auto d = find(*value, {"distortioncoefficients"})) {
        camera.coefficients = d_.numbers(*d, "k1 k2 k3");
        if (camera.coefficients.size() != 3) d_.expected(*d, "k1 k2 k3");
        const std::vector<double>& k = camera.coefficients;
        set_opencv_lens(&camera, {k[0], k[1], 0.0, 0.0, k[2]});
      } else {
        require_no_lens(*value, YAML::Node(), "k1 k2 k3");
      }
      if (const auto skew = find(*value, {"skew"})) set_skew(&camera, d_.number(*skew, "a skew"));
      out.cameras.push_back(std::move(camera));
    }
    return out;
  }

  /// rpg_vikit, as SVO and FAST-LIVO take it.
  CalibrationFile vikit(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "rpg_vikit";
    CameraCalibration camera;
    camera.model = text_of(*find(root, {"cammodel"}));
    camera.width = side(*find(root, {"camwidth"}));
    const auto height = find(root, {"camheight"});
    if (!height) d_.expected(root, "cam_height beside cam_width");
    camera.height = side(*height);
    camera.fx = require(root, {"camfx"}, "cam_fx");
    camera.fy = require(root, {"camfy"}, "cam_fy");
    camera.cx = require(root, {"camcx"}, "cam_cx");
    camera.cy = require(root, {"camcy"}, "cam_cy");
    const std::string model = plain_name(camera.model);
    const auto given = [&](const std::string& prefix, int from) {
      std::vector<double> values;
      std::size_t used = 0;
      for (int i = 0; i < 4; ++i) {
        const auto value = find(root, {prefix + std::to_string(from + i)});
        values.push_back(value ? d_.number(*value, "a distortion coefficient") : 0.0);
        if (value) used = values.size();
      }
      values.resize(used);
      return values;
    };
    camera.coefficients = given("camd", 0);
    if (model == "pinhole") {
      set_opencv_lens(&camera, camera.coefficients);
    } else if (model == "equidistantcamera" || model == "equidistant") {
      if (camera.coefficients.empty()) camera.coefficients = given("k", 1);
      if (camera.coefficients.empty()) require_no_lens(root, YAML::Node(), camera.model);
      set_fisheye_lens(&camera, camera.coefficients);
    } else {
      camera.unsupported = "its camera model \"" + printable(camera.model) + "\" is not supported";
    }
    out.cameras.push_back(std::move(camera));
    return out;
  }

  static bool is_orb_slam(const YAML::Node& root) {
    return find_by_plain_name(root, {"camerafx", "camera1fx", "leftk"}).has_value();
  }

  CalibrationFile orb_slam(const YAML::Node& root) const {
    CalibrationFile out;
    out.form = "ORB-SLAM";
    std::string type = "opencv";
    if (const auto given = find(root, {"cameratype"})) type = text_of(*given);
    const bool fisheye = plain_name(type) == "kannalabrandt8";
    const bool second = find(root, {"camera2fx"}).has_value();
    for (const std::string prefix : {"camera", "camera1", "camera2"}) {
      if (!find(root, {prefix + "fx"})) continue;
      CameraCalibration camera;
      camera.fx = require(root, {prefix + "fx"}, "fx");
      camera.fy = require(root, {prefix + "fy"}, "fy");
      camera.cx = require(root, {prefix + "cx"}, "cx");
      camera.cy = require(root, {prefix + "cy"}, "cy");
      if (second) camera.name = prefix == "camera2" ? "Camera2" : "Camera1";
      camera.coefficients = named_coefficients(root, prefix, fisheye);
      if (camera.coefficients.empty()) require_no_lens(root, YAML::Node(), fisheye ? type : "");
      camera.model = plain_name(type) == "pinhole" ? "opencv" : type;
      set_lens_by_word(&camera, camera.model, camera.coefficients);
      set_size(root, &camera, "camera");
      out.cameras.push_back(std::move(camera));
    }
    if (!out.cameras.empty()) return out;
    for (const std::string prefix : {"left", "right"}) {
      const auto matrix = find(root, {prefix + "k"});
      if (!matrix) continue;
      CameraCalibration camera;
      camera.name = prefix;
      camera.model = "opencv";
      set_matrix(*matrix, &camera);
      if (const auto d = find(root, {prefix + "d"}))
        camera.coefficients = d_.numbers(*d, "coefficients");
      set_opencv_lens(&camera, camera.coefficients);
      set_size(root, &camera, prefix);
      out.cameras.push_back(std::move(camera));
    }
    return out;
  }

  const Document& d_;
};

}  // namespace

std::optional<CalibrationFile> calibration_of_document(const Document& document) {
  return DocumentReader(document).read();
}

}  // namespace camber
