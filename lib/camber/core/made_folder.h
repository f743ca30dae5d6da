#pragma once

#include <filesystem>

namespace camber {

/// A folder for files of a result: where it, or folders above it, were made here and are not kept,
/// they go away again with all in them, also where the program is ended by a signal
/// (discard_staged_outputs()).
class MadeFolder {
 public:
  /// @throws OutputError where it is not there and cannot be made.
  explicit MadeFolder(const std::filesystem::path& folder);
  ~MadeFolder();
  MadeFolder(const MadeFolder&) = delete;
  MadeFolder& operator=(const MadeFolder&) = delete;
  void keep() noexcept;

 private:
  std::filesystem::path first_;  // the topmost that was not there before; empty: none, or kept
};

}  // namespace camber
