#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

constexpr const char* kSeparators = " \t\r\n,;:=<>\"'/[]{}()|";

/// Where a header of lines ends and the body begins; the whole length where there is no such
/// header.
std::size_t header_size(std::string_view input) {
  const auto after_line = [&](std::size_t at) {
    const std::size_t end = input.find('\n', at);
    return end == std::string_view::npos ? input.size() : end + 1;
  };
  if (input.substr(0, 3) == "ply") {
    const std::size_t at = input.find("end_header");
    if (at != std::string_view::npos) return after_line(at);
  }
  for (const char* const mark : {"\nDATA ", "\n$$$$"}) {
    const std::size_t at = input.find(mark);
    if (at != std::string_view::npos) return after_line(at + 1);
  }
  return input.size();
}

std::vector<std::string> lines_of(std::string_view text) {
  std::vector<std::string> out;
  std::size_t from = 0;
  while (from < text.size()) {
    const std::size_t end = std::min(text.find('\n', from), text.size() - 1);
    out.emplace_back(text.substr(from, end + 1 - from));
    from = end + 1;
  }
  return out;
}

struct Span {
  std::size_t from, size;
};

std::vector<Span> words_of(std::string_view text) {
  std::vector<Span> out;
  std::size_t from = text.find_first_not_of(kSeparators);
  while (from != std::string_view::npos) {
    const std::size_t end = std::min(text.find_first_of(kSeparators, from), text.size());
    out.push_back({from, end - from});
    from = text.find_first_not_of(kSeparators, end);
  }
  return out;
}

void change_lines(std::vector<std::string>* lines, Dice& dice) {
  const std::size_t n = lines->size(), at = dice.below(n);
  std::string& line = (*lines)[at];
  const auto place = lines->begin() + static_cast<long>(at);
  switch (dice.below(8)) {
    case 0:
      lines->erase(place);
      break;
    case 1:
      lines->insert(place, std::string(line));
      break;
    case 2:
      std::swap(line, (*lines)[dice.below(n)]);
      break;
    case 3: {
      const std::string other = (*lines)[dice.below(n)];
      lines->insert(place, other);
      break;
    }
    case 4:
      line.insert(0, 1 + dice.below(4), dice.one_in(4) ? '\t' : ' ');
      break;
    case 5:
      line.erase(0, std::min(line.find_first_not_of(" \t"), line.size()));
      break;
    case 6: {
      if (!line.empty() && line.back() == '\n') line.pop_back();
      break;
    }
    default:
      line.resize(dice.below(line.size() + 1));
      line += '\n';
  }
}

void change_word(std::string* text, Dice& dice, const ByteMutation& bytes) {
  const std::vector<Span> words = words_of(*text);
  if (words.empty()) return;
  const Span at = words[dice.below(words.size())];
  const std::string word = text->substr(at.from, at.size);
  std::string now = word;
  switch (dice.below(8)) {
    case 0:
      now.clear();
      break;
    case 1:
      now = word + " " + word;
      break;
    case 2:
    case 3: {
      const Span other = words[dice.below(words.size())];
      now = text->substr(other.from, other.size);
      break;
    }
    case 4:
      now = bytes(word, word.size() + 4);
      break;
    default:
      now = odd_number_text(dice);
  }
  text->replace(at.from, at.size, now);
}

}  // namespace

std::string mutate_text(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  const std::size_t border = header_size(input);
  std::string head(input.substr(0, border)), body(input.substr(border));
  if (!body.empty() && dice.one_in(3)) {
    switch (dice.below(4)) {
      case 0:
        body.resize(dice.below(body.size()));
        break;
      case 1:
        body += body.substr(dice.below(body.size()));
        break;
      default:
        body = bytes(body, body.size() + 16);
    }
  } else if (dice.one_in(3)) {
    std::vector<std::string> lines = lines_of(head);
    if (lines.empty()) return bytes(input, input.size() + 16);
    change_lines(&lines, dice);
    head.clear();
    for (const std::string& line : lines) head += line;
  } else {
    change_word(&head, dice, bytes);
  }
  return head + body;
}

std::string mutate_document(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  const std::size_t first = input.find_first_not_of(" \t\r\n");
  const bool json = first != std::string_view::npos &&
                    (input[first] == '{' || input[first] == '[') && nlohmann::json::accept(input);
  return json ? mutate_json(input, dice, bytes) : mutate_text(input, dice, bytes);
}

std::string mutate_text_or_numbers(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  const bool text = std::none_of(input.begin(), input.end(), [](char c) {
    return c >= 0 && c < ' ' && c != '\n' && c != '\r' && c != '\t';
  });
  return text ? mutate_text(input, dice, bytes) : mutate_numbers(input, dice, bytes);
}

}  // namespace camber::fuzz
