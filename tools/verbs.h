#pragma once

namespace camber::tools {

/// A command of the program, and the plugin that holds it.
struct Verb {
  const char* name;
  const char* plugin;   ///< "clouds": no OpenCV is loaded; "frames": all others
  const char* summary;  ///< one line, for the list of commands
};

/// All commands, in the order of the list.
inline constexpr Verb kVerbs[] = {
    {"reconstruct", "frames", "a few frames of one moving camera to a metric road with vehicles"},
    {"drive", "frames", "a whole drive: trajectory, the road along it, vehicles as tracks"},
    {"calibrate", "frames",
     "the camera of a drive by its own pictures, each number with its sigma"},
    {"triangulate", "frames", "the road cloud alone"},
    {"vehicles", "frames", "vehicles alone, from a scene's detections, keypoints and planes"},
    {"detect", "frames", "boxes and road masks of a scene's frames by networks (ONNX)"},
    {"plane", "clouds", "one plane of a cloud with outliers"},
    {"patches", "clouds", "planar patches of a road cloud and their consistency graph"},
    {"ground", "clouds", "the ground of a cloud, separated from what stands on it"},
    {"profile", "frames", "height, grade and cross slope along a road"},
    {"lift", "clouds", "yaw-only 3D boxes of a detector put on a road surface"},
    {"export", "clouds", "the road for other programs: OpenCRG, OpenDRIVE, GeoTIFF, meshes"},
    {"compare", "frames", "an estimated cloud, mesh or result against dense truth"},
    {"evaluate", "frames", "errors of vehicles, trajectories and tracks against truth"},
    {"render", "frames", "pictures, films, glTF or a report, without a display"},
    {"view", "clouds", "the interactive viewer"},
    {"import", "frames", "scene manifests from own films, images and bags, and from data sets"},
    {"keypoints", "frames", "crops to train the keypoint network, and its errors"},
    {"prior", "frames", "shape and size priors of vehicles"},
    {"synth", "frames", "made scenes and whole drives with cars and complete truth"},
    {"info", "clouds", "what clouds, COLMAP models, scenes and results hold"},
    {"convert", "clouds", "clouds, COLMAP models and depth images as cloud files"},
    {"filter", "clouds", "crops, thins, cleans and sorts a cloud, or gives it normals"},
    {"tiles", "clouds", "clouds larger than memory: sorted into tiles, worked on, joined"},
};

}  // namespace camber::tools
