#pragma once

#include <optional>
#include <string>

#include "camber/import/formats/calibration.h"
#include "camber/import/formats/detail/document.h"

namespace camber {

// The forms of read_calibration() by family; nothing where the file is of none of them.

/// YAML, JSON and OpenCV's XML.
std::optional<CalibrationFile> calibration_of_document(const Document& document);

/// XML that is not OpenCV's: Metashape.
std::optional<CalibrationFile> calibration_of_xml(const std::string& text,
                                                  const std::filesystem::path& path);

/// Lines of text: COLMAP, kapture, KITTI, ROS INI, ZED, a bare 3 x 3 matrix.
std::optional<CalibrationFile> calibration_of_text(const std::filesystem::path& path,
                                                   const std::string& text);

/// Sets the lens from coefficients k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]].
void set_opencv_lens(CameraCalibration* camera, std::vector<double> coefficients);
/// From k1 [k2 [k3 [k4]]] of the equidistant model.
void set_fisheye_lens(CameraCalibration* camera, std::vector<double> coefficients);
/// Leaves a skew of a pixel or two, as calibrations have by their own errors, out with a note; a
/// larger one is not supported.
/// @param skew  pixels of x for each unit of y at depth 1
void set_skew(CameraCalibration* camera, double skew);
/// By the word that a file has for its model, over coefficients in OpenCV's order.
void set_lens_by_word(CameraCalibration* camera, const std::string& word,
                      const std::vector<double>& coefficients);

}  // namespace camber
