# CAMBER_LIBRARIES: "name version" of the libraries that the program is built with, as
# `camber --version --json` prints them.
set(CAMBER_LIBRARIES "")
foreach(entry IN ITEMS
    "Ceres ${Ceres_VERSION}" "Eigen ${Eigen3_VERSION}" "Embree ${embree_VERSION}"
    "fmt ${fmt_VERSION}" "libpng ${PNG_VERSION_STRING}" "nlohmann-json ${nlohmann_json_VERSION}"
    "OpenCV ${OpenCV_VERSION}" "pugixml ${pugixml_VERSION}" "TBB ${TBB_VERSION}"
    "VTK ${VTK_VERSION}" "yaml-cpp ${yaml-cpp_VERSION}")
  if(entry MATCHES "^[^ ]+ [0-9]")
    list(APPEND CAMBER_LIBRARIES "${entry}")
  endif()
endforeach()
# camber_version_in(NAME REGEX HEADERS...): the numbers that REGEX captures in the headers' lines.
function(camber_version_in name regex)
  set(parts "")
  foreach(header IN LISTS ARGN)
    if(NOT EXISTS ${header})
      continue()
    endif()
    file(STRINGS ${header} lines REGEX "${regex}")
    foreach(line IN LISTS lines)
      string(REGEX REPLACE ".*${regex}.*" "\\1" part "${line}")
      list(APPEND parts ${part})
    endforeach()
  endforeach()
  list(JOIN parts "." version)
  if(version)
    set(CAMBER_LIBRARIES ${CAMBER_LIBRARIES} "${name} ${version}" PARENT_SCOPE)
  endif()
endfunction()
find_path(CLI11_INCLUDE_DIR CLI/Version.hpp REQUIRED)
camber_version_in(CLI11 "define CLI11_VERSION \"([0-9.]+)\"" ${CLI11_INCLUDE_DIR}/CLI/Version.hpp)
if(CAMBER_HAS_GDAL)
  camber_version_in(GDAL "define GDAL_RELEASE_NAME +\"([0-9.]+)" ${GDAL_INCLUDE_DIR}/gdal_version.h)
endif()
camber_version_in(libavformat "define LIBAVFORMAT_VERSION_M[A-Z]+ +([0-9]+)"
                  ${LIBAV_INCLUDE_DIR}/libavformat/version_major.h
                  ${LIBAV_INCLUDE_DIR}/libavformat/version.h)
camber_version_in(libjpeg-turbo "define LIBJPEG_TURBO_VERSION +([0-9.]+)"
                  ${JPEG_INCLUDE_DIR}/jconfig.h
                  ${JPEG_INCLUDE_DIR}/${CMAKE_LIBRARY_ARCHITECTURE}/jconfig.h)
camber_version_in(PCL "define PCL_VERSION_PRETTY \"([0-9.]+)" ${PCL_INCLUDE_DIRS}/pcl/pcl_config.h)
camber_version_in(PROJ "define PROJ_VERSION_[A-Z]+ +([0-9]+)$" ${PROJ_INCLUDE_DIR}/proj.h)
camber_version_in(toml++ "define TOML_LIB_[A-Z]+ +([0-9]+)$"
                  ${TOMLPLUSPLUS_INCLUDE_DIR}/toml++/impl/version.h)
camber_version_in(xxHash "define XXH_VERSION_[A-Z]+ +([0-9]+)$" ${XXHASH_INCLUDE_DIR}/xxhash.h)
list(SORT CAMBER_LIBRARIES CASE INSENSITIVE)
