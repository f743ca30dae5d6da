#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// A word or phrase that the sources no longer use.
struct OldWord {
  std::vector<std::string> parts;    ///< lower case
  std::vector<std::string> folders;  ///< of lib/camber, where it is looked for; empty: everywhere
  std::string text;                  ///< as the table has it
};

/// The rows of the table | old | new | only in | of a Markdown text; an old cell may list several,
/// with commas between them.
std::vector<OldWord> read_old_words(const std::string& markdown);

/// The words of a line of C++, lower case, names split where they change case and at underscores.
std::vector<std::string> words_of(const std::string& line);

/// C++ with all that stands between quotes left out (raw strings too), line by line as it was.
std::string without_text(const std::string& source);

/// "lib/camber/road/x.h:12: stance" for each old word in the names and comments of the C++ sources
/// below root/lib, root/tools and root/viewers, in order.
std::vector<std::string> find_old_words(const std::filesystem::path& root,
                                        const std::vector<OldWord>& words);

}  // namespace camber::test
