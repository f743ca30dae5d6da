#include "camber/core/made_folder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
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

TEST(MadeFolder, GoesAwayWithTheFoldersAboveItThatItMade) {
  const test::TemporaryFolder folder;
  { const MadeFolder dropped(folder.path() / "above" / "made"); }
  EXPECT_FALSE(fs::exists(folder.path() / "above"));
  fs::create_directory(folder.path() / "above");
  { const MadeFolder dropped(folder.path() / "above" / "made"); }
  EXPECT_TRUE(fs::is_empty(folder.path() / "above"));
}

TEST(MadeFolder, GoesAwayWhereASignalEndsTheProgram) {
  const test::TemporaryFolder folder;
  const fs::path left = folder.path() / "left", done = folder.path() / "done";
  const auto end = [&] {
    const MadeFolder half(left / "image");
    std::ofstream(left / "image" / "file") << "half";
    MadeFolder kept(done);
    kept.keep();
    discard_staged_outputs();
    std::_Exit(0);
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(0), "");
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(done));
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
