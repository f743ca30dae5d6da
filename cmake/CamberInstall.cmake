# Installs the program with its plugins, the modules as static libraries, their public headers, and
# a package configuration with a component for each module, so that another project says
# find_package(camber COMPONENTS plane) and links camber::plane.
include(CMakePackageConfigHelpers)

get_property(modules GLOBAL PROPERTY CAMBER_MODULES)
get_property(plugins GLOBAL PROPERTY CAMBER_PLUGINS)
set(camber_package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/camber)
if(TARGET camber)
  install(TARGETS camber RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
  install(TARGETS ${plugins} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/camber COMPONENT program)
  # The man pages and the shells' completions are made of the program's --help.
  find_package(Python3 QUIET COMPONENTS Interpreter)
  if(Python3_Interpreter_FOUND)
    install(
      CODE "set(camber_program \"$<TARGET_FILE:camber>\")
            set(share \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_DATADIR}\")
            execute_process(COMMAND \"${Python3_EXECUTABLE}\" -B
             \"${PROJECT_SOURCE_DIR}/docs/make_pages.py\" \"\${camber_program}\" --man
             \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_MANDIR}/man1\"
             COMMAND_ERROR_IS_FATAL ANY)
            execute_process(COMMAND \"${Python3_EXECUTABLE}\" -B
             \"${PROJECT_SOURCE_DIR}/docs/make_completions.py\" \"\${camber_program}\"
             --bash \"\${share}/bash-completion/completions/camber\"
             --zsh \"\${share}/zsh/vendor-completions/_camber\"
             --fish \"\${share}/fish/vendor_completions.d/camber.fish\"
             COMMAND_ERROR_IS_FATAL ANY)"
      COMPONENT program)
  endif()
endif()
foreach(module IN LISTS modules)
  string(REGEX REPLACE "^camber_" "" name ${module})
  install(
    TARGETS ${module}
    EXPORT ${module}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development OPTIONAL)
  install(
    EXPORT ${module}
    NAMESPACE camber::
    FILE camber-${name}.cmake
    DESTINATION ${camber_package_folder}
    COMPONENT development)
  # Where the program alone was built, as samples/run.sh does, some modules are not there.
  install(
    CODE "if(NOT EXISTS \"$<TARGET_FILE:${module}>\")
            message(STATUS \"Not installed: camber::${name}, which is not built\")
            file(GLOB files \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${camber_package_folder}/camber-${name}.cmake\"
                 \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${camber_package_folder}/camber-${name}-*.cmake\")
            if(files)
              file(REMOVE \${files})
            endif()
          endif()"
    COMPONENT development)
  if(NOT IS_DIRECTORY ${PROJECT_SOURCE_DIR}/lib/camber/${name})
    continue()  # a target within a folder: its headers come with the folder's
  endif()
  install(
    DIRECTORY lib/camber/${name}
    DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/camber
    COMPONENT development
    FILES_MATCHING
    PATTERN "*.h"
    PATTERN "detail" EXCLUDE)
endforeach()

# The package that a project must find before it can link a module: a line for each kind of name
# that the modules' link lists mention; \1 is the component. A name without a line is an error, so
# that no new dependency can be forgotten.
set(camber_package_of
    "Threads::.*" "Threads"
    "Eigen3::.*" "Eigen3 3.4"
    "fmt::.*" "fmt"
    "nlohmann_json::.*" "nlohmann_json"
    "TBB::.*" "TBB"
    "PNG::.*" "PNG"
    "JPEG::.*" "JPEG"
    "OpenMP::.*" "OpenMP"
    "OpenGL::(.*)" "OpenGL COMPONENTS \\1"
    "X11::.*" "X11"
    "ZLIB::.*" "ZLIB"
    "embree" "embree 3.13"
    "yaml-cpp" "yaml-cpp"
    "pugixml::.*" "pugixml"
    "opencv_(.*)" "OpenCV COMPONENTS \\1"
    "[Cc]eres(::ceres)?" "Ceres"
    "VTK::(.*)" "VTK COMPONENTS \\1")

# camber_describe_module(MODULE RESULT) describes a module to the package's configuration: the
# modules that it links, then the packages, each with all its components.
function(camber_describe_module module result)
  set(needs "")
  set(packages "")
  get_target_property(libraries ${module} INTERFACE_LINK_LIBRARIES)
  foreach(library IN LISTS libraries)
    string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" library "${library}")
    if(library MATCHES "^camber::(.*)$")
      list(APPEND needs ${CMAKE_MATCH_1})
      continue()
    elseif(library MATCHES "^(libraries-NOTFOUND|/.*|-.*|m|dl|rt)$")
      continue()  # a system library by its path, a linker option
    endif()
    set(found FALSE)
    set(patterns ${camber_package_of})
    while(patterns AND NOT found)
      list(POP_FRONT patterns pattern package)
      if(library MATCHES "^${pattern}$")
        string(REGEX REPLACE "^${pattern}$" "${package}" package "${library}")
        set(found TRUE)
      endif()
    endwhile()
    if(NOT found)
      message(FATAL_ERROR "${module} links ${library}: cmake/CamberInstall.cmake does not know "
                          "which package holds it; add it to camber_package_of there")
    endif()
    string(REGEX REPLACE " COMPONENTS .*" "" name "${package}")
    if(NOT name IN_LIST packages)
      list(APPEND packages ${name})
    endif()
    if(package MATCHES " COMPONENTS (.*)$")
      list(APPEND components_${name} ${CMAKE_MATCH_1})
    endif()
  endforeach()
  list(REMOVE_DUPLICATES needs)
  set(calls "")
  foreach(name IN LISTS packages)
    if(components_${name})
      list(REMOVE_DUPLICATES components_${name})
      list(JOIN components_${name} " " components)
      string(APPEND name " COMPONENTS ${components}")
    endif()
    if(name MATCHES "^VTK")
      # Debian's VTK configuration names MPI's C targets without finding them.
      list(APPEND calls "MPI COMPONENTS C")
    endif()
    list(APPEND calls "${name}")
  endforeach()
  string(REGEX REPLACE "^camber_" "" module ${module})
  list(JOIN needs " " needs)
  list(TRANSFORM calls REPLACE "^.+$" "\"\\0\"")
  list(JOIN calls " " calls)
  set(${result} "set(_camber_needs_${module} ${needs})\nset(_camber_packages_${module} ${calls})\n"
      PARENT_SCOPE)
endfunction()

set(CAMBER_COMPONENTS ${modules})
list(TRANSFORM CAMBER_COMPONENTS REPLACE "^camber_" "")
list(JOIN CAMBER_COMPONENTS " " CAMBER_COMPONENTS)
set(CAMBER_DESCRIPTIONS "")
foreach(module IN LISTS modules)
  camber_describe_module(${module} description)
  string(APPEND CAMBER_DESCRIPTIONS "${description}")
endforeach()

configure_package_config_file(
  cmake/camber-config.cmake.in ${PROJECT_BINARY_DIR}/camber-config.cmake
  INSTALL_DESTINATION ${camber_package_folder} PATH_VARS CMAKE_INSTALL_INCLUDEDIR
  NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/camber-config-version.cmake
                                 COMPATIBILITY SameMinorVersion)
install(
  FILES ${PROJECT_BINARY_DIR}/camber-config.cmake ${PROJECT_BINARY_DIR}/camber-config-version.cmake
  DESTINATION ${camber_package_folder}
  COMPONENT development)
