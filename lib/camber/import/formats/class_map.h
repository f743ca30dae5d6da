#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace camber {

/// One class of a segmentation.
struct MaskClass {
  std::string name;
  std::optional<int> id, train_id;
  std::optional<std::array<int, 3>> color;  ///< red, green, blue
  std::string category;
};

/// The classes of a segmentation: what its values or colours mean.
struct ClassMap {
  std::vector<MaskClass> classes;
  bool has_colors() const;
  bool has_ids() const;
};

/// Reads a table of classes: CSV with a header line (name, id, train_id, red green blue), the label
/// map of VOC and CVAT (label:r,g,b:parts:actions), the YAML of SemanticKITTI (labels, color_map
/// blue first), a plain list of names from id 0, or {"name": id} in JSON or YAML.
/// @throws InputError "file: position: found, expected".
ClassMap read_class_map(const std::filesystem::path& path);

/// The map of a data set by its name, or nothing: "kitti-road", "cityscapes", "cityscapes-train",
/// "bdd100k", "bdd100k-drivable", "mapillary" (Vistas 1.2), "mapillary-2" (Vistas 2.0), "camber".
/// Only the classes that Camber uses and those that stand beside them.
std::optional<ClassMap> named_class_map(const std::string& name);
std::vector<std::string> class_map_names();

/// What a class is to Camber.
enum class MaskRole { kOther, kRoad, kPavement, kVehicle };

/// By the class's name: "road", "construction--flat--road", "lane-marking", "sidewalk", "car", ...
MaskRole role_of_class(const std::string& name);

}  // namespace camber
