# Installs the program, the modules as static libraries, their headers, and a package
# configuration, so that another project says find_package(camber) and links camber::pipeline.
include(CMakePackageConfigHelpers)

get_property(modules GLOBAL PROPERTY CAMBER_MODULES)
install(
  TARGETS ${modules}
  EXPORT camberTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
if(TARGET camber)
  install(TARGETS camber RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
foreach(module IN LISTS modules)
  string(REGEX REPLACE "^camber_" "" folder ${module})
  if(NOT IS_DIRECTORY ${PROJECT_SOURCE_DIR}/lib/camber/${folder})
    continue()  # a target within a folder: its headers come with the folder's
  endif()
  install(
    DIRECTORY lib/camber/${folder}
    DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/camber
    COMPONENT development
    FILES_MATCHING
    PATTERN "*.h"
    PATTERN "detail" EXCLUDE)
endforeach()

# The packages that a project must find before it can link the static libraries: a line for each
# kind of name that the modules' link lists mention; \1 is the component. A name without a line is
# an error, so that no new dependency can be forgotten.
set(camber_package_of
    "Threads::.*" "Threads"
    "Eigen3::.*" "Eigen3 3.4"
    "fmt::.*" "fmt"
    "spdlog::.*" "spdlog"
    "nlohmann_json::.*" "nlohmann_json"
    "TBB::.*" "TBB"
    "PNG::.*" "PNG"
    "JPEG::.*" "JPEG"
    "OpenMP::.*" "OpenMP"
    "OpenGL::(.*)" "OpenGL COMPONENTS \\1"
    "X11::.*" "X11"
    "PNG::.*" "PNG"
    "JPEG::.*" "JPEG"
    "ZLIB::.*" "ZLIB"
    "opencv_(.*)" "OpenCV COMPONENTS \\1"
    "[Cc]eres(::ceres)?" "Ceres"
    "MPI::.*" "MPI COMPONENTS C"
    "VTK::.*" "VTK"
    "pcl_(.*)" "PCL COMPONENTS \\1")
set(camber_needed "")
foreach(module IN LISTS modules)
  get_target_property(libraries ${module} INTERFACE_LINK_LIBRARIES)
  foreach(library IN LISTS libraries)
    string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" library "${library}")
    if(library MATCHES "^(libraries-NOTFOUND|camber::.*|/.*|-.*|m|dl|rt)$")
      continue()  # a module, a system library by its path, a linker option
    endif()
    set(found FALSE)
    set(patterns ${camber_package_of})
    while(patterns AND NOT found)
      list(POP_FRONT patterns pattern package)
      if(library MATCHES "^${pattern}$")
        string(REGEX REPLACE "^${pattern}$" "${package}" package "${library}")
        list(APPEND camber_needed "${package}")
        set(found TRUE)
      endif()
    endwhile()
    if(NOT found)
      message(FATAL_ERROR "${module} links ${library}: cmake/CamberInstall.cmake does not know "
                          "which package holds it; add it to camber_package_of there")
    endif()
  endforeach()
endforeach()
if("VTK" IN_LIST camber_needed)
  # Debian's VTK configuration names MPI's C targets without finding them.
  list(PREPEND camber_needed "MPI COMPONENTS C")
endif()
list(REMOVE_DUPLICATES camber_needed)
list(TRANSFORM camber_needed PREPEND "find_dependency(")
list(TRANSFORM camber_needed APPEND ")")
list(JOIN camber_needed "\n" CAMBER_FIND_DEPENDENCIES)

set(CAMBER_EXPORTED_TARGETS "${modules}")
list(TRANSFORM CAMBER_EXPORTED_TARGETS REPLACE "^camber_" "camber::")

set(camber_package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/camber)
configure_package_config_file(
  cmake/camber-config.cmake.in ${PROJECT_BINARY_DIR}/camber-config.cmake
  INSTALL_DESTINATION ${camber_package_folder} PATH_VARS CMAKE_INSTALL_INCLUDEDIR
  NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/camber-config-version.cmake
                                 COMPATIBILITY SameMinorVersion)
install(
  EXPORT camberTargets
  NAMESPACE camber::
  DESTINATION ${camber_package_folder}
  COMPONENT development)
install(
  FILES ${PROJECT_BINARY_DIR}/camber-config.cmake ${PROJECT_BINARY_DIR}/camber-config-version.cmake
  DESTINATION ${camber_package_folder}
  COMPONENT development)
