#pragma once

#include <filesystem>
#include <system_error>
#include <utility>

#include "camber/core/errors.h"

namespace camber {

/// A folder for files of a result: where it was made here and is not kept, it goes away again with
/// all in it.
class MadeFolder {
 public:
  /// @throws OutputError where it is not there and cannot be made.
  explicit MadeFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::error_code error;
    made_ = std::filesystem::create_directories(folder_, error);
    if (error) throw OutputError(folder_.string(), "cannot be created: " + error.message());
  }
  ~MadeFolder() {
    std::error_code ignored;
    if (made_) std::filesystem::remove_all(folder_, ignored);
  }
  MadeFolder(const MadeFolder&) = delete;
  MadeFolder& operator=(const MadeFolder&) = delete;
  void keep() { made_ = false; }

 private:
  std::filesystem::path folder_;
  bool made_ = false;
};

}  // namespace camber
