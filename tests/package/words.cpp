#include "package/words.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <sstream>

#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber::test {
namespace {

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r`");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r`") - first + 1);
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> out;
  std::istringstream in(text);
  std::string part;
  while (std::getline(in, part, separator)) out.push_back(trimmed(part));
  return out;
}

/// The C++ sources below a folder of the root, as paths relative to the root.
std::vector<std::string> sources_below(const fs::path& root, const std::string& folder) {
  std::vector<std::string> out;
  if (!fs::exists(root / folder)) return out;
  for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
    const std::string extension = entry.path().extension().string();
    if (entry.is_regular_file() && (extension == ".h" || extension == ".cpp")) {
      out.push_back(entry.path().lexically_relative(root).generic_string());
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

bool applies(const OldWord& word, const std::string& file) {
  if (word.folders.empty()) return true;
  return std::any_of(word.folders.begin(), word.folders.end(), [&](const std::string& folder) {
    return starts_with(file, "lib/camber/" + folder + "/");
  });
}

/// Steps over a literal whose opening quote is at `at`, and returns where it ends.
std::size_t end_of_literal(const std::string& source, std::size_t at) {
  const char quote = source[at];
  for (std::size_t i = at + 1; i < source.size(); ++i) {
    if (source[i] == '\\') {
      ++i;
    } else if (source[i] == quote || source[i] == '\n') {
      return i;
    }
  }
  return source.size();
}

}  // namespace

std::vector<OldWord> read_old_words(const std::string& markdown) {
  std::vector<OldWord> out;
  bool inside = false;
  std::istringstream lines(markdown);
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> cells = split(line, '|');
    if (cells.size() < 3) {
      inside = false;
    } else if (cells[1] == "old" && cells[2] == "new") {
      inside = true;
    } else if (inside && !starts_with(cells[1], "--")) {
      for (const std::string& text : split(cells[1], ',')) {
        OldWord word{words_of(text), {}, text};
        if (cells.size() > 3 && !cells[3].empty()) word.folders = split(cells[3], ',');
        out.push_back(std::move(word));
      }
    }
  }
  return out;
}

std::vector<std::string> words_of(const std::string& line) {
  const auto is = [&](std::size_t i, auto&& kind) {
    return i < line.size() && kind(static_cast<unsigned char>(line[i])) != 0;
  };
  const auto upper = [](int c) { return std::isupper(c); };
  const auto lower = [](int c) { return std::islower(c); };
  const auto digit = [](int c) { return std::isdigit(c); };
  std::vector<std::string> out(1);
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool letter = is(i, upper) || is(i, lower) || is(i, digit);
    const bool begins =
        is(i, upper) && i > 0 &&
        (is(i - 1, lower) || is(i - 1, digit) || (is(i - 1, upper) && is(i + 1, lower)));
    if ((!letter || begins) && !out.back().empty()) out.emplace_back();
    if (letter) out.back() += static_cast<char>(std::tolower(static_cast<unsigned char>(line[i])));
  }
  if (out.back().empty()) out.pop_back();
  return out;
}

std::string without_text(const std::string& source) {
  std::string out;
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (source.compare(i, 2, "//") == 0) {
      // A comment quotes what files hold; an apostrophe in it opens nothing.
      const std::size_t end = std::min(source.find('\n', i), source.size());
      for (; i < end; ++i) {
        const std::size_t close = source[i] == '"' ? source.find('"', i + 1) : end;
        if (close < end) i = close;
        out += source[i];
      }
      --i;
    } else if (source.compare(i, 2, "R\"") == 0) {
      const std::size_t open = source.find('(', i);
      if (open == std::string::npos) break;
      const std::string close = ")" + source.substr(i + 2, open - i - 2) + "\"";
      const std::size_t end = std::min(source.find(close, open), source.size());
      out += "\"";
      for (; i < end; ++i) out += source[i] == '\n' ? "\n" : "";
      i += close.size() - 1;
    } else if (source[i] == '"') {
      i = end_of_literal(source, i);
      out += "\"";
    } else if (source[i] == '\'' &&
               !(i > 0 && std::isalnum(static_cast<unsigned char>(source[i - 1])) != 0)) {
      i = end_of_literal(source, i);  // not the separator of digits
      out += "\"";
    } else {
      out += source[i];
    }
  }
  return out;
}

std::vector<std::string> find_old_words(const fs::path& root, const std::vector<OldWord>& words) {
  std::vector<std::string> out;
  for (const char* folder : {"lib", "tools", "viewers"}) {
    for (const std::string& file : sources_below(root, folder)) {
      std::istringstream lines(without_text(read_text(root / file)));
      std::string line;
      for (int number = 1; std::getline(lines, line); ++number) {
        const std::vector<std::string> found = words_of(line);
        for (const OldWord& word : words) {
          if (!applies(word, file)) continue;
          if (std::search(found.begin(), found.end(), word.parts.begin(), word.parts.end()) ==
              found.end()) {
            continue;
          }
          out.push_back(file + ":" + std::to_string(number) + ": " + word.text);
        }
      }
    }
  }
  return out;
}

}  // namespace camber::test
