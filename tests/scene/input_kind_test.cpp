#include "camber/scene/input_kind.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/core/errors.h"
#include "camber/scene/scene.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

void make(const fs::path& file) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << "x";
}

TEST(InputKindOf, IsByWhatIsThere) {
  const test::TemporaryFolder folder;
  const fs::path& at = folder.path();
  for (const char* file :
       {"drive.MP4", "drive.bag", "drive.mcap", "ros2/metadata.yaml", "ros2/a.db3", "clip/0001.jpg",
        "scene/scene.json", "scene/image/1.png", "result/run.json", "result/overlay_1.png",
        "notes/readme.txt", "other.json"}) {
    make(at / file);
  }
  EXPECT_EQ(kind_of_input(at / "drive.MP4"), InputKind::kVideo);
  for (const char* bag : {"drive.bag", "drive.mcap", "ros2"}) {
    EXPECT_EQ(kind_of_input(at / bag), InputKind::kBag) << bag;
  }
  EXPECT_EQ(kind_of_input(at / "clip"), InputKind::kImages);
  for (const char* scene :
       {"scene", "scene/scene.json", "result", "notes", "other.json", "none", "none.mp4"}) {
    EXPECT_EQ(kind_of_input(at / scene), InputKind::kScene) << scene;
  }
}

TEST(InputKindOf, IsNamedWhereASceneIsExpected) {
  const test::TemporaryFolder folder;
  make(folder.path() / "drive.mp4");
  try {
    read_scene(folder.path() / "drive.mp4");
    FAIL() << "a film was read";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("drive.mp4"), HasSubstr("found a film"),
                                    HasSubstr("camber import video ")));
  }
}

}  // namespace
}  // namespace camber
