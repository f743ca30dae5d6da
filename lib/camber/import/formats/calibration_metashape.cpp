// Calibrations of Agisoft Metashape (PhotoScan): the file of one lens, and the sensors in the file
// of cameras. The model: Metashape's manual, appendix "Camera models".

#include <fmt/format.h>

#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"
#include "camber/import/formats/detail/xml_file.h"

namespace camber {
namespace {

constexpr int kMaxSide = 65535;

class MetashapeReader {
 public:
  explicit MetashapeReader(const XmlFile& file) : file_(file) {}

  std::optional<CalibrationFile> read() const {
    const pugi::xml_node root = file_.root();
    CalibrationFile out;
    out.form = "Metashape";
    if (std::string(root.name()) == "calibration") {
      out.cameras.push_back(camera(root, root));
      return out;
    }
    if (std::string(root.name()) != "document") return std::nullopt;
    for (const pugi::xpath_node& found : root.select_nodes(".//sensors/sensor")) {
      const pugi::xml_node sensor = found.node();
      pugi::xml_node calibration =
          sensor.find_child_by_attribute("calibration", "class", "adjusted");
      if (!calibration) calibration = sensor.child("calibration");
      if (!calibration) continue;
      out.cameras.push_back(camera(calibration, sensor));
      const char* const label = sensor.attribute("label").value();
      out.cameras.back().name = *label ? label : sensor.attribute("id").value();
    }
    if (out.cameras.empty()) file_.fail(root, "found no sensor with a calibration, expected one");
    return out;
  }

 private:
  double value(const pugi::xml_node& node, const char* name) const {
    return node.child(name) ? file_.child_number(node, name) : 0.0;
  }
  int side(const pugi::xml_node& at, double pixels) const {
    if (!(pixels >= 1.0 && pixels <= kMaxSide) || pixels != std::floor(pixels)) {
      file_.fail(at,
                 fmt::format("found {} pixels, expected a whole number from 1 to 65535", pixels));
    }
    return static_cast<int>(pixels);
  }

  CameraCalibration camera(const pugi::xml_node& node, const pugi::xml_node& sensor) const {
    CameraCalibration out;
    const pugi::xml_node resolution =
        node.child("resolution") ? node.child("resolution") : sensor.child("resolution");
    if (resolution) {
      out.width = side(resolution, file_.attribute_number(resolution, "width"));
      out.height = side(resolution, file_.attribute_number(resolution, "height"));
    } else {
      out.width = side(node, file_.child_number(node, "width"));
      out.height = side(node, file_.child_number(node, "height"));
    }
    // Lengths from the middle of the image; b1 and b2 are those of pixels that are no squares.
    const bool two = node.child("fx") && node.child("fy");  // of old versions
    const double f = two ? file_.child_number(node, "fy") : file_.child_number(node, "f");
    out.fx = two ? file_.child_number(node, "fx") : f + value(node, "b1");
    out.fy = f;
    out.first_pixel = 0.5;
    const bool whole =
        two && value(node, "cx") > 0.25 * *out.width;  // of old versions: from the corner
    out.cx = value(node, "cx") + (whole ? 0.0 : 0.5 * *out.width);
    out.cy = value(node, "cy") + (whole ? 0.0 : 0.5 * *out.height);
    std::string type = node.child_value("projection");
    if (type.empty()) type = node.attribute("type").value();
    out.model = "metashape " + (type.empty() ? std::string("frame") : type);
    const double k1 = value(node, "k1"), k2 = value(node, "k2"), k3 = value(node, "k3"),
                 k4 = value(node, "k4"), p1 = value(node, "p1"), p2 = value(node, "p2");
    out.coefficients = {k1, k2, k3, k4, p1, p2};
    if (type == "fisheye") {
      set_fisheye_lens(&out, {k1, k2, k3, k4});
      if (p1 != 0.0 || p2 != 0.0)
        out.unsupported = "its fisheye lens has tangential terms, which are not supported";
    } else if (!type.empty() && type != "frame") {
      out.unsupported = "its projection \"" + printable(type) + "\" is not supported";
    } else {
      // Its first tangential term is along x, OpenCV's along y.
      set_opencv_lens(&out, {k1, k2, p2, p1, k3});
      if (k4 != 0.0 || value(node, "p3") != 0.0 || value(node, "p4") != 0.0)
        out.unsupported = "its k4, p3 or p4 are not supported (a fit without them is)";
    }
    set_skew(&out, value(node, "b2"));
    return out;
  }

  const XmlFile& file_;
};

}  // namespace

std::optional<CalibrationFile> calibration_of_xml(const std::string& text,
                                                  const std::filesystem::path& path) {
  const XmlFile file = XmlFile::parse(text, path.string());
  return MetashapeReader(file).read();
}

}  // namespace camber
