// The sources use the field's words: none of those that docs/conventions.md lists as replaced.

#include "package/words.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "package/source_tree.h"
#include "support/test_data.h"

using camber::test::find_old_words;
using camber::test::OldWord;
using camber::test::read_old_words;
using camber::test::SourceTree;
using camber::test::without_text;
using camber::test::words_of;
using testing::ElementsAre;
using testing::IsEmpty;

namespace {

std::vector<OldWord> listed_words() {
  std::ifstream in(camber::test::source_dir() / "docs/conventions.md");
  std::ostringstream text;
  text << in.rdbuf();
  return read_old_words(text.str());
}

constexpr char kTable[] =
    "text | with a bar\n\n"
    "| old | new | only in |\n|---|---|---|\n"
    "| stance | contact | |\n| grey, grey values | intensity | motion, scale |\n\n"
    "| other | table | |\n|---|---|---|\n| road | way | |\n";

TEST(Words, OfTheHouseAreNotInTheSources) {
  const std::vector<OldWord> words = listed_words();
  ASSERT_GT(words.size(), 30u) << "docs/conventions.md has no table of words";
  EXPECT_THAT(find_old_words(camber::test::source_dir(), words), IsEmpty());
}

TEST(Words, AreReadFromTheirTableAlone) {
  const std::vector<OldWord> words = read_old_words(kTable);
  ASSERT_EQ(words.size(), 3u);
  EXPECT_THAT(words[0].parts, ElementsAre("stance"));
  EXPECT_THAT(words[0].folders, IsEmpty());
  EXPECT_THAT(words[2].parts, ElementsAre("grey", "values"));
  EXPECT_THAT(words[2].folders, ElementsAre("motion", "scale"));
}

TEST(Words, AreFoundInNamesOfAnyCaseAndInComments) {
  const SourceTree tree({{"lib/camber/road/a.h", "struct StanceTerms {};\nint stance_at(int);\n"},
                         {"tools/b.cpp", "// The stance of a car.\nint kGrey;\n"},
                         {"viewers/c.cpp", "int circumstance, distance;\n"}});
  EXPECT_THAT(find_old_words(tree.root(), read_old_words(kTable)),
              ElementsAre("lib/camber/road/a.h:1: stance", "lib/camber/road/a.h:2: stance",
                          "tools/b.cpp:1: stance"));
}

TEST(Words, ThatAreBoundToFoldersAreFoundThereAlone) {
  const SourceTree tree({{"lib/camber/motion/a.h", "int grey;\n"},
                         {"lib/camber/motion/sub/a.h", "\n// Grey values.\n"},
                         {"lib/camber/render/a.h", "int grey;\n"}});
  EXPECT_THAT(find_old_words(tree.root(), read_old_words(kTable)),
              ElementsAre("lib/camber/motion/a.h:1: grey", "lib/camber/motion/sub/a.h:2: grey",
                          "lib/camber/motion/sub/a.h:2: grey values"));
}

TEST(Words, InTextForReadersAreLeftOut) {
  const SourceTree tree(
      {{"lib/camber/road/a.cpp",
        "const char* a = \"stance \\\" stance\";\nconst char* b = R\"X(\nstance)X\";\nint stance;\n"
        "char c = '\"'; int d = 1'000; int stance2; int stance_b;\n"},
       {"lib/camber/road/b.cpp", "const char* a = \"stance\";\n"}});
  EXPECT_THAT(find_old_words(tree.root(), read_old_words(kTable)),
              ElementsAre("lib/camber/road/a.cpp:4: stance", "lib/camber/road/a.cpp:5: stance"));
}

TEST(Words, OfANameAreItsParts) {
  EXPECT_THAT(words_of("  kUSBPort2Names = is_good(x1);"),
              ElementsAre("k", "usb", "port2", "names", "is", "good", "x1"));
}

TEST(Words, TextIsLeftOutLineByLine) {
  EXPECT_EQ(without_text("a \"b\" // c \"d\" e's\n'e' f"), "a \" // c \" e's\n\" f");
}

}  // namespace
