#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "camber/calibrate/drive_lens.h"
#include "camber/geometry/se3.h"

namespace camber {

struct WindowObservation {
  int frame = 0;  ///< of the window
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

/// A point that stands still, as a ray from the reference camera and how far along it: points at
/// infinity have an inverse distance of 0.
struct WindowPoint {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< unit, reference camera
  double inverse_distance = 0.0;                         ///< 1 / unit of the window
  std::vector<WindowObservation> seen;                   ///< at least two frames
};

/// A few successive key frames of a drive with the points that they show; lengths up to scale.
struct CalibrationWindow {
  std::size_t first = 0;                  ///< key frame of the drive
  std::size_t reference = 0;              ///< index into `poses`, whose pose is the identity
  std::vector<SE3> frame_from_reference;  ///< one a key frame
  std::vector<WindowPoint> points;
};

/// Loss of a pixel's error e, in standard deviations: w^2 / 2 log(1 + (e / w)^2) (Cauchy).
struct BundleLoss {
  double pixel_sigma = 0.3;  ///< px, of a coordinate, > 0
  double width = 2.0;        ///< w, standard deviations, > 0
  /// Errors that are alike count once: what the pixels know is divided by this, >= 1.
  double correlation = 1.0;
};

/// How a vehicle goes: where a window's chord lies in its middle camera, against straight on. In a
/// turn the camera, which is before the rear axle, is carried outwards, and the chord of an uneven
/// arc is no tangent.
struct TravelNoise {
  double straight = 0.015;  ///< rad, > 0
  double of_turn = 0.25;    ///< of the window's turn, >= 0
};

/// Sideways and upward angle of a window's chord in its reference camera, rad; that of a camera
/// that looks back is turned round. Nothing without a chord.
std::optional<Eigen::Vector2d> travel_of_window(const CalibrationWindow& window);

/// The normal equations of one window with its points and poses eliminated (Triggs, McLauchlan,
/// Hartley, Fitzgibbon, "Bundle Adjustment - A Modern Synthesis", 2000, section 6.1): what it knows
/// of the lens.
struct LensInformation {
  DriveLens::Matrix information = DriveLens::Matrix::Zero();
  DriveLens::Vector gradient = DriveLens::Vector::Zero();  ///< of the cost
  double cost = 0.0;
};

/// Bundle adjustment of a window over poses, points and the lens that all windows share.
class WindowBundle {
 public:
  explicit WindowBundle(CalibrationWindow window);

  const CalibrationWindow& window() const { return window_; }
  std::size_t observations() const;

  /// Linearises about the window as it is. @param damping  Levenberg and Marquardt's, >= 0, of
  /// poses and points.
  LensInformation reduce(const DriveLens& lens, const BundleLoss& loss, double damping);
  /// Moves a copy of the window by the step that belongs to a change of the lens, by the last
  /// reduce(); accept() makes it the window.
  void try_step(const DriveLens::Vector& lens_step);
  const CalibrationWindow& tried() const { return tried_; }
  void accept();
  void set_window(CalibrationWindow window);

  /// Of pixels and travel.
  static double cost(const CalibrationWindow& window, const DriveLens& lens,
                     const BundleLoss& loss);
  /// Errors of all observations, px, in the order of points and frames; NaN behind a camera.
  static std::vector<Eigen::Vector2d> errors(const CalibrationWindow& window,
                                             const DriveLens& lens);

 private:
  void add_travel(const DriveLens& lens, Eigen::MatrixXd* information, Eigen::VectorXd* gradient,
                  double* cost) const;
  Eigen::Index parameters_of_poses() const;
  Eigen::Index row_of(int frame) const;  // of a frame's pose; -1: the reference

  CalibrationWindow window_, tried_;  // of the same observations
  // Of the last reduce(), for the way back.
  struct Eliminated {
    Eigen::Matrix3d inverse;  // of the damped block
    Eigen::Vector3d gradient;
    Eigen::Matrix<double, 3, Eigen::Dynamic> by_camera;  // lens, then the frames that see it
    std::vector<Eigen::Index> rows;                      // first row of each frame's block
  };
  std::vector<Eliminated> eliminated_;
  Eigen::MatrixXd poses_by_lens_;
  Eigen::VectorXd poses_step_;
};

}  // namespace camber
