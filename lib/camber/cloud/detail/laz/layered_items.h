#pragma once

#include <memory>

#include "camber/cloud/detail/laz/laz_format.h"

namespace camber::laz {

/// One of a chunk's streams of bytes: each attribute has its own.
template <typename Coder>
struct Layer {
  Coder coder;
  bool on = Coder::kEncoding;  ///< decoding: it is there and wanted
  bool changed = false;        ///< encoding: some value differs from what a decoder has without it
};

/// A part of a record whose attributes lie in layers of a chunk: items of versions 3 and 4.
template <typename Coder>
class LayeredItem {
 public:
  virtual ~LayeredItem() = default;
  /// Takes the chunk's first item, which is not coded.
  /// @param channel  the scanner channel of the point; the item with the coordinates sets it
  virtual void start(const unsigned char* item, unsigned* channel) = 0;
  /// The next one, into or out of its layers.
  /// @param channel  whose contexts the other items use; the item with the coordinates sets it
  virtual void code(Layer<Coder>* layers, unsigned char* item, unsigned* channel) = 0;
};

/// @param item  one that is not is_pointwise()
template <typename Coder>
std::unique_ptr<LayeredItem<Coder>> make_layered_item(const LazItem& item);

}  // namespace camber::laz
