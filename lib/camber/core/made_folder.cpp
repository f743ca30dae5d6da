#include "camber/core/made_folder.h"

#include "camber/core/detail/staging.h"

namespace camber {

MadeFolder::MadeFolder(const std::filesystem::path& folder)
    : first_(staging::make_folders(folder)) {}

MadeFolder::~MadeFolder() {
  if (!first_.empty()) staging::discard_folders(first_);
}

void MadeFolder::keep() noexcept {
  if (!first_.empty()) staging::keep_folders(first_);
  first_.clear();
}

}  // namespace camber
