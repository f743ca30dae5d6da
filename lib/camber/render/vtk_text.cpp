#include <vtkFreeTypeTools.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtkStdString.h>
#include <vtkTextProperty.h>

#include <algorithm>
#include <new>

#include "camber/render/detail/silenced_vtk.h"
#include "camber/render/detail/vtk_drawing.h"

namespace camber {

TextBitmap rasterize_text(const std::string& line, int size, bool bold) {
  const SilencedVtk silenced;  // without memory VTK prints before it throws
  vtkNew<vtkTextProperty> property;
  property->SetFontFamilyToArial();
  property->SetFontSize(size);
  property->SetBold(bold);
  property->SetColor(1, 1, 1);
  vtkFreeTypeTools* tools = vtkFreeTypeTools::GetInstance();
  tools->ScaleToPowerTwoOff();
  int dims[2] = {0, 0};
  constexpr int kPointsPerInch = 72;  // a font size is then a number of pixels
  TextBitmap out;
  if (line.empty()) return out;
  // Not deleted where VTK throws: what it leaves then crashes as it is destroyed.
  vtkImageData* const made = vtkImageData::New();
  const bool is_drawn = tools->RenderString(property, line, kPointsPerInch, made, dims);
  const auto data = vtkSmartPointer<vtkImageData>::Take(made);
  if (!is_drawn) {
    // The font has all letters of ASCII.
    const bool is_ascii =
        std::all_of(line.begin(), line.end(), [](char c) { return c >= ' ' && c <= '~'; });
    if (is_ascii && line.find_first_not_of(' ') != std::string::npos) throw std::bad_alloc();
    return out;
  }
  const int* extent = data->GetExtent();
  out.width = extent[1] - extent[0] + 1;
  out.height = extent[3] - extent[2] + 1;
  const auto channels = static_cast<std::size_t>(data->GetNumberOfScalarComponents());
  const auto* last = static_cast<const std::uint8_t*>(data->GetScalarPointer()) + channels - 1;
  const auto width = static_cast<std::size_t>(out.width);
  out.opacity.resize(width * static_cast<std::size_t>(out.height));
  // VTK's rows go up.
  for (int y = 0; y < out.height; ++y) {
    const std::uint8_t* from =
        last + static_cast<std::size_t>(out.height - 1 - y) * width * channels;
    std::uint8_t* to = out.opacity.data() + static_cast<std::size_t>(y) * width;
    for (std::size_t x = 0; x < width; ++x) to[x] = from[x * channels];
  }
  return out;
}

}  // namespace camber
