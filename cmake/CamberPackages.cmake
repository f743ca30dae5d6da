# Debian packages of the release build, by who builds them:
#   DEBFULLNAME="A Name" DEBEMAIL=name@their.host cpack --config build/release/CPackConfig.cmake -B FOLDER
#   camber           the program with its plugins, man pages and completions
#   camber-viewer    the interactive viewer
#   libcamber-dev    headers, static libraries, the CMake package
#   python3-camber   the Python module
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME camber)
set(CPACK_PACKAGE_VENDOR "the Camber authors")
set(CPACK_PACKAGE_CONTACT "unknown <root@localhost>") # options.cmake: of the environment
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/cmake/packages/options.cmake)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ
                                                GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_COMPONENTS_ALL program development)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME camber)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
# Pictures are drawn without a display by Mesa's EGL, which is loaded at run time.
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS "libegl1, libegl-mesa0, libgl1-mesa-dri")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS "camber-viewer, python3-camber")
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION
    "metric road surfaces and vehicles from one moving camera
Camber turns a few frames of one moving camera into a metric road surface of
planar patches with their uncertainty, puts vehicles on it in 3D, and works on
the road clouds that come out of that or out of a laser scanner: planes,
ground, patches, profiles, comparison, pictures without a display.")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libcamber-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
# What the static libraries link and the headers include.
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "libavcodec-dev, libavformat-dev, libavutil-dev, libceres-dev, libegl-dev, libeigen3-dev (>= 3.4), \
libembree-dev, libfmt-dev, libgdal-dev, libgl-dev, libjpeg-dev, liblz4-dev, liblzf-dev, libopencv-dev, libopenmpi-dev, \
libpcl-dev, libpng-dev, libproj-dev, libpugixml-dev, libsqlite3-dev, libswscale-dev, libtbb-dev, libvtk9-dev, \
libxxhash-dev, libyaml-cpp-dev, libzstd-dev, nlohmann-json3-dev, zlib1g-dev")
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION
    "metric road surfaces from one moving camera - development files
Headers, static libraries and the CMake package of Camber, a component for
each of its modules.")

if(TARGET camber-view)
  list(APPEND CPACK_COMPONENTS_ALL viewer)
  set(CPACK_DEBIAN_VIEWER_PACKAGE_NAME camber-viewer)
  set(CPACK_DEBIAN_VIEWER_PACKAGE_SECTION science)
  set(CPACK_DEBIAN_VIEWER_PACKAGE_DEPENDS "libgl1-mesa-dri")
  set(CPACK_DEBIAN_VIEWER_PACKAGE_RECOMMENDS "camber")
  set(CPACK_DEBIAN_VIEWER_DESCRIPTION
      "metric road surfaces from one moving camera - interactive viewer
Shows road clouds, planar patches and vehicles that Camber has found, with
their uncertainty, in 3D.")
endif()

if(TARGET camber_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-camber)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  math(EXPR next "${CAMBER_PYTHON_MINOR} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
      "libegl1, libegl-mesa0, libgl1-mesa-dri, python3 (>= 3.${CAMBER_PYTHON_MINOR}), python3 (<< 3.${next}), python3-numpy")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "python3-matplotlib")
  set(CPACK_DEBIAN_PYTHON_DESCRIPTION
      "metric road surfaces from one moving camera - Python module
The main job of Camber from numpy arrays, and planes, ground, patches and
comparison of road clouds.")
endif()

# Copyright, changelog, compressed man pages; dates are those of the last commit, so that two builds
# give equal files.
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/packages/finish.cmake)
set(CPACK_CAMBER_SOURCE_DIR ${PROJECT_SOURCE_DIR})
set(CPACK_CAMBER_VERSION ${PROJECT_VERSION})
include(CPack)
