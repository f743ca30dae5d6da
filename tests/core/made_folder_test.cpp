#include "camber/core/made_folder.h"

#include <gtest/gtest.h>

#include <fstream>

#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

TEST(MadeFolder, GoesAwayWithAllInItUnlessItIsKept) {
  const test::TemporaryFolder folder;
  const fs::path made = folder.path() / "made";
  {
    const MadeFolder dropped(made);
    std::ofstream(made / "file") << "half";
    EXPECT_TRUE(fs::exists(made / "file"));
  }
  EXPECT_FALSE(fs::exists(made));
  {
    MadeFolder kept(made);
    kept.keep();
  }
  EXPECT_TRUE(fs::is_directory(made));
}

TEST(MadeFolder, LeavesWhatWasThereBefore) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "old") << "old";
  { const MadeFolder there(folder.path()); }
  EXPECT_TRUE(fs::exists(folder.path() / "old"));
}

TEST(MadeFolder, RefusesANameThatAFileHas) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "file") << "old";
  EXPECT_THROW(MadeFolder(folder.path() / "file" / "in_it"), OutputError);
}

}  // namespace
}  // namespace camber
