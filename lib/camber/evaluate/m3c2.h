#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber {

struct M3c2Options {
  double normal_scale = 0.0;  ///< m, diameter around a core point whose plane gives its normal
  double cylinder = 0.0;      ///< m, diameter of the cylinders
  double core_spacing = 0.0;  ///< m between core points
  double max_depth = 0.0;     ///< m that a cylinder reaches to either side of its core point
  double registration_sigma = 0.0;    ///< m, how well the clouds lie on each other, >= 0
  bool vertical = false;              ///< along `up` everywhere (method dz), not along normals
  Eigen::Vector3d up{0.0, 0.0, 1.0};  ///< normals point to its side; in the clouds' frame
  int num_threads = 0;                ///< <= 0: see resolve_num_threads
  void validate() const;              ///< throws std::invalid_argument naming field, value, bound
};

/// The change at one core point; NaN where one of the clouds has no point in its cylinder.
struct CoreChange {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();             ///< m, of the earlier cloud
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();            ///< unit
  double distance = std::numeric_limits<double>::quiet_NaN();  ///< m, later less earlier; + is gain
  double detection_limit = std::numeric_limits<double>::quiet_NaN();  ///< m, at 95 %
  double sigma =
      std::numeric_limits<double>::quiet_NaN();  ///< m, of the distance, registration out
  bool significant = false;                      ///< |distance| > detection_limit
  std::size_t earlier = 0, later = 0;            ///< points in the cylinder
};

struct CloudChange {
  bool metric = true;
  M3c2Options used;  ///< with what was chosen in place of zeros
  std::vector<CoreChange> cores;
  std::size_t measured = 0, significant = 0;
  double mean = std::numeric_limits<double>::quiet_NaN();          ///< m, signed, of the measured
  double median = std::numeric_limits<double>::quiet_NaN();        ///< m, signed
  double median_limit = std::numeric_limits<double>::quiet_NaN();  ///< m, of detection limits
  /// Of the significant cells, a cell being the square of core_spacing of a core point's place in
  /// plan: area m^2, and vertical change times cell, m^3, each with its standard deviation.
  double gain_area = 0.0, loss_area = 0.0;
  double gain_volume = 0.0, loss_volume = 0.0;  ///< positive
  double gain_volume_sigma = 0.0, loss_volume_sigma = 0.0, net_volume = 0.0, net_volume_sigma = 0.0;
};

/// The change between two epochs after Lague, Brodu, Leroux, "Accurate 3D comparison of complex
/// topography with terrestrial laser scanner: application to the Rangitikei canyon (N-Z)", ISPRS
/// Journal 2013 (M3C2). Core points are the earlier cloud's, one in each cube of `core_spacing`
/// (the nearest to its middle). A core point's normal is that of the plane through the earlier
/// points within half of `normal_scale`; both clouds are averaged inside the cylinder around it.
/// The detection limit is 1.96 (sqrt(s1^2 / n1 + s2^2 / n2) + registration_sigma), s being the
/// standard deviation (n - 1) of the distances along the axis, or the root mean square of the
/// points' own sigmas, where that is larger. Cylinders with fewer than 4 points of either cloud
/// have a distance but no limit, and are never significant.
///
/// Sizes that are 0 are chosen: the cylinder so that the sparser cloud has some 30 points in it
/// (25 points a square metre: 1.2 m), three times that for the normals, half of it between
/// core points, and 2 m of depth or four cylinders, whatever is more.
/// @throws std::invalid_argument if options.validate() fails; NoAnswerError if a cloud has no
/// points or no core point sees both. Same answer for any number of threads.
CloudChange measure_change(const RoadCloud& later, const RoadCloud& earlier,
                           const M3c2Options& options = {});

/// A few lines for a person: the signed change and its detection limit first.
std::string describe(const CloudChange& change);
/// change.json, without the names of the clouds. Not finite numbers are null.
nlohmann::json to_json(const CloudChange& change);

}  // namespace camber
