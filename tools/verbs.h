#pragma once

namespace camber::tools {

/// A command of the program, and the plugin that holds it.
struct Verb {
  const char* name;
  const char* plugin;   ///< "clouds": no OpenCV is loaded; "frames": all others
  bool reuses_memory;   ///< works on one image after the other, in arrays of the same sizes
  const char* summary;  ///< one line, for the list of commands
};

/// All commands, in the order of the list.
inline constexpr Verb kVerbs[] = {
    {"reconstruct", "frames", true,
     "a few frames of one moving camera to a metric road with vehicles"},
    {"triangulate", "frames", true, "the road cloud alone"},
    {"vehicles", "frames", true, "vehicles alone, from a scene's detections, keypoints and planes"},
    {"detect", "frames", true, "boxes and road masks of a scene's frames by networks (ONNX)"},
    {"plane", "clouds", false, "one plane of a cloud with outliers"},
    {"patches", "clouds", false, "planar patches of a road cloud and their consistency graph"},
    {"ground", "clouds", false, "the ground of a cloud, separated from what stands on it"},
    {"profile", "frames", false, "height, grade and cross slope along a road"},
    {"lift", "clouds", false, "yaw-only 3D boxes of a detector put on a road surface"},
    {"export", "clouds", false, "the road for other programs: OpenCRG, OpenDRIVE, GeoTIFF, meshes"},
    {"compare", "frames", false, "an estimated cloud, mesh or result against dense truth"},
    {"evaluate", "frames", false, "tables of vehicle localisation errors against truth"},
    {"render", "frames", true, "pictures, films, glTF or a report, without a display"},
    {"view", "clouds", false, "the interactive viewer"},
    {"import", "frames", false, "scene manifests from other data sets"},
    {"keypoints", "frames", true, "crops to train the keypoint network, and its errors"},
    {"prior", "frames", false, "shape and size priors of vehicles"},
    {"synth", "frames", true, "a made scene of a steep road with cars and complete truth"},
    {"info", "clouds", false, "what clouds, COLMAP models, scenes and results hold"},
    {"convert", "clouds", false, "clouds, COLMAP models and depth images as cloud files"},
    {"filter", "clouds", false, "crops, thins, cleans and sorts a cloud, or gives it normals"},
};

}  // namespace camber::tools
