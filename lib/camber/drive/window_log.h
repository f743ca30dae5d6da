#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/drive/window_measurement.h"
#include "camber/scene/json_value.h"

namespace camber {

/// What was decided of one frame when it was read.
struct FrameRecord {
  enum class Kind {
    kKey,         ///< a window of its own
    kBetween,     ///< its motion alone: too little parallax to the key frame before
    kRepeated,    ///< the same picture as the frame before
    kUnreadable,  ///< see reason
  };
  int frame = 0;  ///< id
  Kind kind = Kind::kKey;
  std::string reason;
  bool still = false;  ///< nothing below the horizon moves from the frame before
};

/// @throws UsageError that names the first key in which the inputs and options of what is in a
///         drive's folder differ from the wanted ones.
void require_equal_header(const std::filesystem::path& folder, const nlohmann::json& there,
                          const nlohmann::json& wanted);

/// The checkpoint of a drive: what was measured so far, appended record by record with its length
/// and a hash, so that what a killed run leaves is a prefix of what it would have written.
class WindowLog {
 public:
  /// Goes on with what is there if that begins with the same header; cuts off a last record that is
  /// not whole. Without `resume` starts anew.
  /// @param header  inputs and options: what has to be equal for the records to be of use.
  /// @throws UsageError for another header (names the first key that differs); InputError for a
  /// file
  ///         that is no such log; OutputError.
  WindowLog(std::filesystem::path path, const nlohmann::json& header, bool resume);

  const std::vector<FrameRecord>& frames() const { return frames_; }
  /// Whether a window with that reference is there, of a key frame or of one between.
  bool has_window(int reference) const;

  void append(const FrameRecord& frame);
  void append(const WindowMeasurement& window);
  /// Brings what was appended to the disk.
  void flush();

  /// Calls back for every window, in the order in which they were appended.
  void for_each_window(const std::function<void(WindowMeasurement)>& visit) const;

 private:
  void write(char kind, const std::vector<std::uint8_t>& bytes);

  std::filesystem::path path_;
  std::ofstream out_;
  std::vector<FrameRecord> frames_;
  std::vector<int> references_;  // ascending
};

}  // namespace camber
