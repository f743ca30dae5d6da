#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/detect/detector.h"
#include "camber/image/image.h"

namespace camber {

/// Results of networks in a folder, by content: the key of an entry is a hash of the network's
/// file, its description and the image's pixels, so that nothing in it is ever out of date. An
/// entry that cannot be read counts as absent, one that cannot be written is left out: a run never
/// fails on its cache. Entries may be deleted at any time.
class DetectionCache {
 public:
  /// @param folder  made when something is written; empty: nothing is read or written.
  explicit DetectionCache(std::filesystem::path folder) : folder_(std::move(folder)) {}

  std::optional<std::vector<DetectedVehicle>> find_boxes(const std::string& key) const;
  void put_boxes(const std::string& key, const std::vector<DetectedVehicle>& boxes) const;

  /// Labels of an image of that size.
  std::optional<Image> find_labels(const std::string& key, int width, int height) const;
  void put_labels(const std::string& key, const Image& labels) const;

  /// A word about a network: Network::layers().
  std::optional<std::string> find_word(const std::string& key) const;
  void put_word(const std::string& key, const std::string& word) const;

 private:
  template <typename Write>
  void put(const std::filesystem::path& path, const Write& write) const;

  std::filesystem::path folder_;
};

}  // namespace camber
