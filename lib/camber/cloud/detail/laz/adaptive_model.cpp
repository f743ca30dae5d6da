#include "camber/cloud/detail/laz/adaptive_model.h"

#include <algorithm>

namespace camber::laz {
namespace {

constexpr std::uint32_t kMostSymbolsCounted = 1u << kSymbolBits;
constexpr std::uint32_t kMostBitsCounted = 1u << kBitBits;
constexpr std::uint32_t kOne = 1u << 31;

}  // namespace

SymbolModel::SymbolModel(unsigned symbols) : symbols_(symbols) {
  // Two to four hints a symbol: few steps are left, whose number no processor foresees.
  unsigned hint_bits = 2;
  while ((1u << hint_bits) < 2 * symbols) ++hint_bits;
  hint_shift_ = kSymbolBits - hint_bits;
  const std::size_t hints = std::size_t{1} << hint_bits;
  memory_ = std::make_unique<std::uint16_t[]>(2 * symbols + 1 + hints);
  starts_ = memory_.get();
  counts_ = starts_ + symbols + 1;
  hints_ = counts_ + symbols;
  starts_[symbols] = 1u << kSymbolBits;
  std::fill_n(counts_, symbols, std::uint16_t{1});
  cycle_ = symbols;
  update();
  until_update_ = cycle_ = (symbols + 6) / 2;
}

void SymbolModel::update() {
  total_ += cycle_;
  if (total_ > kMostSymbolsCounted) {
    total_ = 0;
    for (std::uint32_t s = 0; s < symbols_; ++s) {
      counts_[s] = static_cast<std::uint16_t>((counts_[s] + 1) / 2);
      total_ += counts_[s];
    }
  }
  const std::uint32_t scale = kOne / total_;
  std::uint32_t sum = 0;
  for (std::uint32_t s = 0; s < symbols_; ++s) {
    starts_[s] = static_cast<std::uint16_t>(scale * sum >> (31 - kSymbolBits));
    sum += counts_[s];
  }
  std::uint32_t symbol = 0;
  const std::uint32_t hints = 1u << (kSymbolBits - hint_shift_);
  for (std::uint32_t h = 0; h < hints; ++h) {
    while (starts_[symbol + 1] <= h << hint_shift_) ++symbol;
    hints_[h] = static_cast<std::uint16_t>(symbol);
  }
  cycle_ = std::min(5 * cycle_ / 4, (symbols_ + 6) * 8);
  until_update_ = cycle_;
}

void BitModel::update() {
  total_ += cycle_;
  if (total_ > kMostBitsCounted) {
    total_ = (total_ + 1) / 2;
    zero_count_ = (zero_count_ + 1) / 2;
    if (zero_count_ == total_) ++total_;
  }
  zero_ = zero_count_ * (kOne / total_) >> (31 - kBitBits);
  cycle_ = std::min(5 * cycle_ / 4, 64u);
  until_update_ = cycle_;
}

}  // namespace camber::laz
