#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "camber/cloud/point_stream.h"

namespace camber {

/// One attribute of a cloud file.
struct AttributeSummary {
  std::string name;  ///< as in the file
  std::string type;  ///< "int8" ... "uint64", "float32", "float64"
  double minimum = std::numeric_limits<double>::quiet_NaN();  ///< of the finite values
  double maximum = std::numeric_limits<double>::quiet_NaN();
  std::uint64_t non_finite = 0;
  double first = std::numeric_limits<double>::quiet_NaN();  ///< of the first point
  double last = std::numeric_limits<double>::quiet_NaN();
  /// Of classification, return_number and class_flags of LAS files: how many points have each value
  /// that occurs; else empty.
  std::map<int, std::uint64_t> counts;
};

/// What a cloud file holds.
struct CloudSummary {
  ReadReport report;
  CloudFrame frame = CloudFrame::kUnknown;
  bool metric = true;
  std::optional<Eigen::Vector3d> origin;  ///< if the file records one
  std::uint64_t points = 0;
  std::uint64_t non_finite = 0;  ///< points with a NaN or infinite coordinate
  /// Bounds of the finite points, in the file's units; NaN without any.
  Eigen::Vector3d minimum = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  Eigen::Vector3d maximum = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  /// Mean of the finite points; NaN without any.
  Eigen::Vector3d mean = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  std::optional<CoordinateSystem> crs;
  std::shared_ptr<const LasFile> las;        ///< of a LAS file
  std::shared_ptr<const E57File> e57;        ///< of an E57 file
  std::vector<AttributeSummary> attributes;  ///< coordinates included, in the file's order

  /// Of the attribute "sigma" where there is one, over its finite values; else NaN. The quantiles
  /// come from a histogram and are good to 1 %.
  double sigma_mean = std::numeric_limits<double>::quiet_NaN();
  double sigma_median = std::numeric_limits<double>::quiet_NaN();
  double sigma_95 = std::numeric_limits<double>::quiet_NaN();
};

/// Reads a stream to its end in constant memory. @throws InputError as the source does.
CloudSummary summarise(PointSource& source);

/// "int8" ... "float64".
const char* to_string(ScalarType type);

/// "unknown", "camera", "z-up".
const char* to_string(CloudFrame frame);

}  // namespace camber
