// The folders of lib/camber stand in a fixed order and use only those above them.

#include "package/layering.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "package/source_tree.h"
#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::include_violations;
using camber::test::link_violations;
using camber::test::SourceTree;
using camber::test::unlinked_includes;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

namespace {

TEST(IncludeOrder, HoldsInTheWholeLibrary) {
  const fs::path root = camber::test::source_dir() / "lib";
  ASSERT_TRUE(fs::exists(root / "camber/core/errors.h"));
  EXPECT_THAT(include_violations(root), IsEmpty());
}

TEST(IncludeOrder, AcceptsIncludesOfFoldersAbove) {
  const SourceTree tree(
      {{"camber/core/a.h", "#include <string>\n#include <opencv2/core.hpp>\n"},
       {"camber/road/b.h", "#include \"camber/core/a.h\"\n"},
       {"camber/road/b.cpp", "#include <camber/road/b.h>\n#include <pcl/point_types.h>\n"},
       {"camber/pipeline/c.cpp", "#include \"camber/road/b.h\"\n"}});
  EXPECT_THAT(include_violations(tree.root()), IsEmpty());
}

TEST(IncludeOrder, FindsAnUpwardInclude) {
  const SourceTree tree(
      {{"camber/core/a.h", "// comment\n#include \"camber/road/b.h\"\n"}, {"camber/road/b.h", ""}});
  EXPECT_THAT(include_violations(tree.root()),
              ElementsAre("camber/core/a.h:2: core includes camber/road/b.h, but road stands below "
                          "it in the layout"));
}

TEST(IncludeOrder, FindsAnUpwardIncludeInASourceFileAndInAngleBrackets) {
  const SourceTree tree(
      {{"camber/vehicle/a.cpp", "  #  include <camber/scene/b.h>\n"}, {"camber/scene/b.h", ""}});
  EXPECT_THAT(include_violations(tree.root()), ElementsAre(HasSubstr("vehicle includes")));
}

TEST(IncludeOrder, FindsARelativeIncludeOfAnotherFolder) {
  const SourceTree tree(
      {{"camber/motion/a.h", "#include \"../pipeline/b.h\"\n"}, {"camber/pipeline/b.h", ""}});
  EXPECT_THAT(include_violations(tree.root()), ElementsAre(HasSubstr("motion includes")));
}

TEST(IncludeOrder, FindsACycleWithinAFolder) {
  const SourceTree tree({{"camber/road/a.h", "#include \"camber/road/b.h\"\n"},
                         {"camber/road/b.h", "#include \"camber/road/c.h\"\n"},
                         {"camber/road/c.h", "#include \"camber/road/a.h\"\n"}});
  EXPECT_THAT(include_violations(tree.root()),
              ElementsAre("cycle: camber/road/a.h -> camber/road/b.h -> camber/road/c.h -> "
                          "camber/road/a.h"));
}

TEST(IncludeOrder, FindsAnUnknownFolderAMissingFileAndAHeavyHeader) {
  const SourceTree tree(
      {{"camber/misc/a.h", ""},
       {"camber/core/b.h", "#include \"camber/core/gone.h\"\n#include <vtkActor.h>\n"},
       {"camber/core/c.cpp", "#include \"gone_too.h\"\n"}});
  EXPECT_THAT(include_violations(tree.root()),
              ElementsAre("camber/core/b.h:1: no file camber/core/gone.h",
                          "camber/core/b.h:2: vtkActor.h belongs into a .cpp file",
                          "camber/core/c.cpp:1: no file gone_too.h beside it",
                          "camber/misc/a.h: folder misc is not in the layout"));
}

/// What the modules link, from the file that the build writes: a line per module.
std::map<std::string, std::vector<std::string>> links_of_the_build() {
  std::ifstream in(CAMBER_LINKS_FILE);
  EXPECT_TRUE(in) << CAMBER_LINKS_FILE;
  std::map<std::string, std::vector<std::string>> links;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string folder, name;
    words >> folder;
    while (words >> name) links[folder].push_back(name);
  }
  return links;
}

TEST(LinkOrder, HoldsForAllModules) {
  auto links = links_of_the_build();
  EXPECT_THAT(links["geometry"], testing::Contains("camber::core"));
  EXPECT_THAT(link_violations(links), IsEmpty());
}

TEST(LinkOrder, CoversAllIncludes) {
  EXPECT_THAT(unlinked_includes(camber::test::source_dir() / "lib", links_of_the_build()),
              IsEmpty());
}

TEST(LinkOrder, FindsAnIncludeThatIsNotLinked) {
  const SourceTree tree(
      {{"camber/core/a.h", ""},
       {"camber/geometry/b.h", "#include <camber/core/a.h>\n"},
       {"camber/cloud/c.h", "#include <camber/core/a.h>\n"},
       {"camber/road/d.h", "#include <camber/core/a.h>\n#include <camber/cloud/c.h>\n"}});
  EXPECT_THAT(unlinked_includes(tree.root(), {{"core", {}},
                                              {"geometry", {"camber::core"}},
                                              {"cloud", {"fmt::fmt"}},
                                              {"road", {"camber_geometry"}}}),
              ElementsAre("target cloud includes files of core but does not link it",
                          "target road includes files of cloud but does not link it"));
}

TEST(LinkOrder, ATargetWithinAFolderMayLinkThatOfTheFolderButNotTheOtherWayRound) {
  EXPECT_THAT(link_violations({{"vehicle_paper", {"camber::vehicle", "camber::core"}},
                               {"pipeline", {"camber::vehicle_paper"}}}),
              IsEmpty());
  EXPECT_THAT(
      link_violations({{"vehicle", {"camber::vehicle_paper"}},
                       {"vehicle_paper", {"camber::pipeline"}},
                       {"attic_paper", {}}}),
      ElementsAre("target attic_paper is not in the layout",
                  "target vehicle links vehicle_paper, which does not stand above it in the layout",
                  "target vehicle_paper links pipeline, which does not stand above it in the "
                  "layout"));
}

TEST(LinkOrder, FindsALinkDownAndToItself) {
  EXPECT_THAT(link_violations({{"core", {"fmt::fmt", "camber::geometry"}},
                               {"road", {"camber::core", "camber_road"}}}),
              ElementsAre("target core links geometry, which does not stand above it in the layout",
                          "target road links road, which does not stand above it in the layout"));
}

}  // namespace
