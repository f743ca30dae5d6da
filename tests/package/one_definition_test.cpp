// A class has a name of its own in the whole tree: of two with one name the linker mixes the
// members without a word.

#include "package/one_definition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "package/source_tree.h"
#include "support/test_data.h"

using camber::test::repeated_definitions;
using camber::test::SourceTree;
using testing::ElementsAre;
using testing::IsEmpty;

namespace {

TEST(OneDefinition, HoldsInTheWholeTree) {
  EXPECT_THAT(
      repeated_definitions(camber::test::source_dir(), {"lib", "tools", "viewers", "tests"}),
      IsEmpty());
}

TEST(OneDefinition, FindsAClassOfTwoSourceFiles) {
  const SourceTree tree(
      {{"a/tree.cpp", "namespace camber {\nclass PointTree {\n ~PointTree();\n};\n}\n"},
       {"b/tree.cpp", "#include <vector>\nnamespace camber {\n\nclass PointTree final {};\n}\n"}});
  EXPECT_THAT(repeated_definitions(tree.root(), {"a", "b"}),
              ElementsAre("camber::PointTree is defined in a/tree.cpp:2 and b/tree.cpp:4"));
  EXPECT_THAT(repeated_definitions(tree.root(), {"b"}), IsEmpty());
}

TEST(OneDefinition, FindsEveryKindHoweverItIsWritten) {
  const SourceTree tree(
      {{"x/a.h",
        "namespace camber::inner { struct alignas(16) A : std::pair<int, int> {}; }\n"
        "namespace camber { enum class B : char { kOne, kTwo }; union C { int i; }; }\n"
        "namespace camber { template <typename T, bool = (1 > 2)> struct D {};\n"
        "template <> struct D<std::vector<int>, true> {}; }\n"
        "extern \"C\" { struct E {}; }\n"},
       {"x/b.cpp",
        "namespace camber { namespace inner { /* { */ struct A {}; } }\n"
        "const int kBig = 1'000; const char kBrace = '{'; const char* kQuoted = \"\\\"{\";\n"
        "const char* kRaw = R\"x(\" { )\" )x\"; // {\n"
        "#define OPEN {    \\\n  {\n"
        "namespace camber { enum struct B { kThree }; union [[nodiscard]] C { float f; };\n"
        "template <int N> struct D {}; template <> struct D<std::vector<int>, true> {}; }\n"
        "struct E {\n  struct A {};\n};\n"}});
  EXPECT_THAT(repeated_definitions(tree.root(), {"x"}),
              ElementsAre("E is defined in x/a.h:5 and x/b.cpp:8",
                          "camber::B is defined in x/a.h:2 and x/b.cpp:6",
                          "camber::C is defined in x/a.h:2 and x/b.cpp:6",
                          "camber::D is defined in x/a.h:3 and x/b.cpp:7",
                          "camber::D<std::vector<int>,true> is defined in x/a.h:4 and x/b.cpp:7",
                          "camber::inner::A is defined in x/a.h:1 and x/b.cpp:1"));
}

TEST(OneDefinition, LeavesOutWhatIsNoDefinitionOrHasNoLinkage) {
  const std::string source =
      "namespace camber {\n"
      "class Declared; enum class Opaque : int;\n"
      "namespace { struct A {}; namespace inner { struct B {}; } }\n"
      "template <class T> void function() { struct Local {}; }\n"
      "struct Declared make() { return {}; }\n"
      "struct Declared kValue{}, kOther = {};\n"
      "enum { kNameless };\n"
      "}\n";
  const SourceTree tree(
      {{"x/a.cpp", source}, {"x/b.cpp", source}, {"x/notes.txt", "struct C {};"}});
  EXPECT_THAT(repeated_definitions(tree.root(), {"x"}), IsEmpty());
}

TEST(OneDefinition, SaysWhereItCannotReadOn) {
  const SourceTree tree({{"x/a.cpp", "namespace camber {\n"}, {"x/b.cpp", "}\n"}});
  EXPECT_THAT(repeated_definitions(tree.root(), {"x"}),
              ElementsAre("x/a.cpp: braces do not balance", "x/b.cpp: braces do not balance"));
}

}  // namespace
