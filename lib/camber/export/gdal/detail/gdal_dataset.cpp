#include "camber/export/gdal/detail/gdal_dataset.h"

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include <cstdio>
#include <string_view>

#include "camber/core/errors.h"

namespace camber::detail {

Complaints::Complaints() { CPLPushErrorHandlerEx(keep, this); }

Complaints::~Complaints() { CPLPopErrorHandler(); }

void Complaints::check(bool is_done) const {
  if (is_done && first_[0] == '\0') return;
  throw MachineError(
      fmt::format("GDAL cannot write the GeoTIFF, most likely for want of memory{}{}",
                  first_[0] == '\0' ? "" : ": ", first_.data()));
}

void CPL_STDCALL Complaints::keep(CPLErr kind, CPLErrorNum, const char* message) {
  auto& first = static_cast<Complaints*>(CPLGetErrorHandlerUserData())->first_;
  if (kind < CE_Failure || first[0] != '\0') return;
  std::snprintf(first.data(), first.size(), "%s", *message == '\0' ? "no reason" : message);
}

Dataset owned(GDALDatasetH file) {
  return {file, [](GDALDatasetH open) {
            if (open != nullptr) GDALClose(open);
          }};
}

bool set_system(GDALDatasetH file, const std::string& crs) {
  const std::unique_ptr<void, void (*)(OGRSpatialReferenceH)> system(
      OSRNewSpatialReference(nullptr), OSRDestroySpatialReference);
  // The definition may come from a result: as a file's name or an address GDAL would open it.
  if (OGRSpatialReference::FromHandle(system.get())
          ->SetFromUserInput(crs.c_str(),
                             OGRSpatialReference::SET_FROM_USER_INPUT_LIMITATIONS_get()) !=
      OGRERR_NONE) {
    const std::string_view reason = CPLGetLastErrorMsg();  // PROJ's, which has no code for it
    for (const char* memory : {"out of memory", "bad_alloc"}) {
      if (reason.find(memory) != std::string_view::npos) return false;
    }
    throw NoAnswerError(
        fmt::format("GDAL does not know the coordinate system '{}'", crs.substr(0, 80)));
  }
  OSRSetAxisMappingStrategy(system.get(), OAMS_TRADITIONAL_GIS_ORDER);
  return GDALSetSpatialRef(file, system.get()) == CE_None;
}

}  // namespace camber::detail
