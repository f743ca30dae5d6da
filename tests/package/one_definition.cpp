#include "package/one_definition.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <map>
#include <sstream>

namespace fs = std::filesystem;

namespace camber::test {
namespace {

struct Token {
  std::string text;
  int line = 0;
};
using Tokens = std::vector<Token>;

bool in_word(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

/// Words, numbers, "::" and single characters; comments, literals and directives are left out.
Tokens read_tokens(const std::string& text) {
  Tokens tokens;
  int line = 1;
  bool line_begins = true;
  std::size_t at = 0;
  const auto advance_to = [&](std::size_t end) {
    end = std::min(end, text.size());
    line += static_cast<int>(std::count(text.begin() + static_cast<long>(at),
                                        text.begin() + static_cast<long>(end), '\n'));
    at = end;
  };
  const auto after = [&](const std::string& mark, std::size_t from) {
    const std::size_t found = text.find(mark, from);
    return found == std::string::npos ? text.size() : found + mark.size();
  };
  while (at < text.size()) {
    const char c = text[at];
    if (c == '\n') line_begins = true;
    if (std::isspace(static_cast<unsigned char>(c)) != 0) {
      advance_to(at + 1);
      continue;
    }
    const bool directive = c == '#' && line_begins;
    line_begins = false;
    if (directive) {
      std::size_t end = at;
      while (end < text.size() && (text[end] != '\n' || text[end - 1] == '\\')) ++end;
      advance_to(end);
    } else if (text.compare(at, 2, "//") == 0) {
      advance_to(text.find('\n', at));
    } else if (text.compare(at, 2, "/*") == 0) {
      advance_to(after("*/", at + 2));
    } else if (text.compare(at, 2, "R\"") == 0) {
      const std::size_t open = text.find('(', at);
      if (open == std::string::npos) break;
      advance_to(after(")" + text.substr(at + 2, open - at - 2) + "\"", open));
    } else if (c == '"' || c == '\'') {
      std::size_t end = at + 1;
      while (end < text.size() && text[end] != c) end += text[end] == '\\' ? 2 : 1;
      advance_to(end + 1);
    } else if (in_word(c)) {
      const bool number = std::isdigit(static_cast<unsigned char>(c)) != 0;
      std::size_t end = at;
      while (end < text.size() && (in_word(text[end]) || (number && text[end] == '\''))) ++end;
      tokens.push_back({text.substr(at, end - at), line});
      advance_to(end);
    } else {
      const std::size_t length = text.compare(at, 2, "::") == 0 ? 2 : 1;
      tokens.push_back({text.substr(at, length), line});
      advance_to(at + length);
    }
  }
  return tokens;
}

/// Position after the bracket that closes the one at `at`; within <> brackets () count too.
std::size_t after_brackets(const Tokens& tokens, std::size_t at) {
  const std::string open = tokens[at].text;
  const std::string close = open == "<" ? ">" : open == "(" ? ")" : "]";
  for (++at; at < tokens.size() && tokens[at].text != close;) {
    const bool deeper = tokens[at].text == open || tokens[at].text == "(";
    at = deeper ? after_brackets(tokens, at) : at + 1;
  }
  return std::min(at + 1, tokens.size());
}

/// The name that a definition's tokens before its '{' give to a class or enumeration; no text if
/// they begin something else or a class without a name.
Token name_of_class(const Tokens& head) {
  const auto is = [&](std::size_t i, const char* text) {
    return i < head.size() && head[i].text == text;
  };
  std::size_t at = 0;
  while (is(at, "template") && is(at + 1, "<")) at = after_brackets(head, at + 1);
  if (is(at, "enum")) {
    at += is(at + 1, "class") || is(at + 1, "struct") ? 2 : 1;
  } else if (is(at, "class") || is(at, "struct") || is(at, "union")) {
    ++at;
  } else {
    return {};
  }
  while (is(at, "[") || (is(at, "alignas") && is(at + 1, "(")) ||
         (is(at, "__attribute__") && is(at + 1, "("))) {
    at = after_brackets(head, is(at, "[") ? at : at + 1);
  }
  Token name;
  while (at < head.size()) {
    const bool after_word = !name.text.empty() && in_word(name.text.back());
    if (!is(at, "::") && !is(at, "<") && (after_word || !in_word(head[at].text[0]))) break;
    const std::size_t end = is(at, "<") ? after_brackets(head, at) : at + 1;
    for (; at < end; ++at) {
      if (name.text.empty()) name.line = head[at].line;
      name.text += head[at].text;
    }
  }
  // `struct Name function() {` and `struct Name value{` define no class.
  return at == head.size() || is(at, ":") || is(at, "final") ? name : Token{};
}

struct Scope {
  bool is_namespace = false;
  bool is_anonymous = false;
  std::string prefix;  ///< of the names in it
};

/// Adds the definitions of one file, name -> "file:line" of the first one in the file.
/// @return whether its braces balance.
bool add_definitions(const std::string& file, const std::string& text,
                     std::map<std::string, std::map<std::string, int>>* definitions) {
  std::vector<Scope> scopes{{true, false, ""}};
  Tokens head;
  for (const Token& token : read_tokens(text)) {
    if (token.text == ";") {
      head.clear();
    } else if (token.text == "}") {
      if (scopes.size() == 1) return false;
      scopes.pop_back();
      head.clear();
    } else if (token.text != "{") {
      head.push_back(token);
    } else {
      const Scope outer = scopes.back();
      Scope inner;
      if (outer.is_namespace) {
        const std::size_t inline_word = !head.empty() && head[0].text == "inline" ? 1 : 0;
        if (head.size() > inline_word && head[inline_word].text == "namespace") {
          inner = {true, outer.is_anonymous || head.size() == inline_word + 1, outer.prefix};
          for (std::size_t i = inline_word + 1; i < head.size(); ++i) inner.prefix += head[i].text;
          inner.prefix += "::";
        } else if (head.size() == 1 && head[0].text == "extern") {
          inner = outer;  // extern "C"
        } else if (!outer.is_anonymous) {
          const Token name = name_of_class(head);
          if (!name.text.empty()) (*definitions)[outer.prefix + name.text].emplace(file, name.line);
        }
      }
      scopes.push_back(inner);
      head.clear();
    }
  }
  return scopes.size() == 1;
}

}  // namespace

std::vector<std::string> repeated_definitions(const fs::path& root,
                                              const std::vector<std::string>& folders) {
  std::vector<std::string> violations;
  std::map<std::string, std::map<std::string, int>> definitions;  // name -> file -> line
  for (const std::string& folder : folders) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (!entry.is_regular_file() || (extension != ".h" && extension != ".cpp")) continue;
      std::ifstream in(entry.path());
      std::ostringstream text;
      text << in.rdbuf();
      const std::string file = entry.path().lexically_relative(root).generic_string();
      if (!add_definitions(file, text.str(), &definitions)) {
        violations.push_back(file + ": braces do not balance");
      }
    }
  }
  for (const auto& [name, places] : definitions) {
    if (places.size() < 2) continue;
    std::string sentence = name + " is defined in ";
    for (const auto& [file, line] : places) {
      if (sentence.back() != ' ') sentence += " and ";
      sentence += file + ":" + std::to_string(line);
    }
    violations.push_back(sentence);
  }
  std::sort(violations.begin(), violations.end());
  return violations;
}

}  // namespace camber::test
