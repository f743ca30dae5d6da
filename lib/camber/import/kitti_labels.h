#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "camber/geometry/box.h"

namespace camber {

/// The two kinds of KITTI label file.
enum class KittiLabelForm {
  kObject,    ///< one file an image, 15 columns, 16 with a score
  kTracking,  ///< one file a sequence, 17 columns (frame and track first), 18 with a score
};

/// One row of a KITTI label file, as it stands there. Positions are in the rectified reference
/// camera (camera 0), metres. A row of type "DontCare" has only its box.
struct KittiLabel {
  int frame = -1;  ///< tracking form only
  int track = -1;  ///< tracking form only; -1: none
  std::string type = "Car";
  double truncated = -1.0;  ///< share in [0, 1]; 2 (tracking): ignored by KITTI; -1: not given
  int occluded = -1;        ///< 0 visible, 1 partly, 2 largely, 3 unknown; -1: not given
  double alpha = -10.0;     ///< observation angle, rad
  Box2 box;                 ///< pixels
  double height = -1.0, width = -1.0, length = -1.0;        ///< m; -1: not given
  Eigen::Vector3d location{-1000.0, -1000.0, -1000.0};      ///< bottom centre
  double rotation_y = -10.0;                                ///< rad
  double score = std::numeric_limits<double>::quiet_NaN();  ///< NaN: none
  int line = 0;  ///< line in the file that it was read from, from 1

  bool dont_care() const { return type == "DontCare"; }
  /// Whether the row has a 3D box.
  bool has_box3() const { return height > 0.0 && width > 0.0 && length > 0.0; }
};

/// A label file's rows in their order, and its form.
struct KittiLabelFile {
  KittiLabelForm form = KittiLabelForm::kObject;
  std::vector<KittiLabel> labels;
};

/// Reads a label file; the number of columns decides the form. An empty file has no rows.
/// @throws InputError "file: line L, column C: found, expected".
KittiLabelFile read_kitti_labels(const std::filesystem::path& path);

/// Writes a label file, six decimals; a score column if any label has a score. Atomic.
/// @throws OutputError; std::invalid_argument for a type that is empty or has blanks.
void write_kitti_labels(const KittiLabelFile& file, const std::filesystem::path& path);

}  // namespace camber
