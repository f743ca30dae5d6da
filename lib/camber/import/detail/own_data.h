#pragma once

#include "camber/image/image.h"
#include "camber/import/formats/calibration.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/import_own.h"

namespace camber {

// The steps that imports of images, videos and models share.

/// Frame ids: the numbers of the file names where all are different ones, else 0, 1, 2, ... in the
/// frames' order; the frames sorted by them.
void number_frames(Scene& scene, OwnImport& out);

/// Times from a rate, over the frames that the numbers of the files leave out: 1, 2, 4 are 0, 1 and
/// 3 steps after the first, 10, 20, 40 too. Where most numbers differ by more than the least step,
/// they count something else, and frames are one step apart.
void put_rate(Scene& scene, double rate, OwnImport& out);

/// The scene's camera from what is given; its size must be set. @throws InputError, UsageError.
void put_camera(Scene& scene, const OwnCamera& camera, OwnImport& out);

/// The scene's camera and lens from a calibration. @param form  what it stands in, for out.found.
/// @throws InputError as lens_of().
void put_calibration(Scene& scene, const CameraCalibration& camera, const std::string& form,
                     bool rectified, const std::filesystem::path& path, OwnImport& out);

/// What a principal point far beside the middle of the images hints at: they were made smaller or
/// larger after the calibration. Empty: it is near enough.
std::string off_centre_camera(const PinholeCamera& camera);

/// Boxes into the frames, clipped to the image. @throws InputError where no box belongs to a frame,
/// or all lie outside.
void put_own_detections(Scene& scene, const OwnDetections& options, OwnImport& out);

// Each gives the frames what a file has of them and adds a phrase to out.found.
// @throws InputError also where it has nothing of any frame; UsageError where frames lack times.
void put_own_masks(Scene& scene, const std::filesystem::path& folder, const std::string& class_map,
                   OwnImport& out);
void put_own_poses(Scene& scene, const std::filesystem::path& file, double scale, OwnImport& out);
void put_own_speeds(Scene& scene, const std::filesystem::path& file, const std::string& offset,
                    OwnImport& out);
/// Speeds between samples of rising time, at most `gap` seconds apart. @return how many frames.
std::size_t put_speeds(Scene& scene, const std::vector<SpeedSample>& samples, double gap);
void put_own_up(Scene& scene, const std::filesystem::path& file, double sigma, OwnImport& out);
/// The positions of a GNSS receiver, or of KITTI's oxts with its headings, as the frames'
/// map_position. Where options.crs is empty it is the UTM zone of the first position.
void put_gnss(Scene& scene, const GnssOptions& options, OwnImport& out);

/// A picture of class colours as Camber's labels 1 road, 2 pavement, 3 vehicle.
/// @throws InputError for another size than the camera's, or mostly other colours than the map's.
Image labels_of_colors(const std::filesystem::path& mask, const ClassMap& classes,
                       const PinholeCamera& camera);

/// Height, the selection of frames, the reference frame, and what is missing.
void finish_import(const OwnDataOptions& options, OwnImport& out);

}  // namespace camber
