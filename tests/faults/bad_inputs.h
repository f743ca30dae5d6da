#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/random.h"

namespace camber::test {

/// Draws from a counter-based generator, one after the other.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint64_t number) : random_(seed, number) {}
  /// A number below `count` > 0.
  std::size_t below(std::size_t count) { return random_.below(next_++, count); }
  bool chance(double share) { return random_.uniform(next_++) < share; }
  template <typename List>
  const auto& one_of(const List& list) {
    return list[below(std::size(list))];
  }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

/// A file's bytes, damaged in one to three ways: cut short, emptied, bytes changed, inserted or
/// left out (half of them in the header), a line lost or repeated, a number replaced by one beyond
/// its range, a value of JSON replaced by one of another type, a key repeated, deep nesting.
std::string damaged(const std::string& bytes, Draws& draws);

/// A command line with one to three mistakes: a value replaced by a bad one (nan, inf, 1e308, -1,
/// empty, very long, ...), an argument lost, repeated or exchanged, an option added.
/// @param options  those that the command has, "--name"
std::vector<std::string> mistyped(std::vector<std::string> arguments,
                                  const std::vector<std::string>& options, Draws& draws);

}  // namespace camber::test
