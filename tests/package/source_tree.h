#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "support/test_data.h"

namespace camber::test {

/// A small tree of sources in a folder of its own: file name -> content.
class SourceTree {
 public:
  explicit SourceTree(const std::map<std::string, std::string>& files) {
    for (const auto& [name, content] : files) {
      std::filesystem::create_directories((folder_.path() / name).parent_path());
      std::ofstream(folder_.path() / name) << content;
    }
  }
  const std::filesystem::path& root() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
};

}  // namespace camber::test
