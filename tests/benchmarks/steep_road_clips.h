#pragma once

#include <filesystem>
#include <map>
#include <vector>

#include "camber/pipeline/reconstruct.h"

namespace camber {

/// A road as a run found it.
struct Road {
  RoadSurface surface;
  RunDocument run;
  VehicleDocument vehicles;  // their plane_source says which patch is theirs
  SharedGround ground;
};

/// Five frames of a steep road with its images and the roads found in them.
struct Clip {
  Scene scene;
  std::map<int, GrayImage> images;  // by frame
  int middle = 0;
  Road three, five;  // roads from the middle three frames and from all five
};

/// All scenes of a folder, in the order of their names. The roads are stored in `keep` and taken
/// from there, where it is not empty.
std::vector<Clip> read_clips(const std::filesystem::path& folder, std::uint64_t seed,
                             const std::filesystem::path& keep);

/// @throws std::runtime_error if there is none.
const TruthFrame& truth_of(const Scene& scene, int frame);

/// One scene of the program's own for each shape of road, where it is not there yet; seeds 101 to
/// 108 for seed 0, 100 on for each further one.
void make_scenes(const std::filesystem::path& folder, std::uint64_t seed);

}  // namespace camber
