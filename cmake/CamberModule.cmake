# camber_add_module(NAME SOURCES ... [PUBLIC targets...] [PRIVATE targets...])
# One folder of lib/camber is one static library camber_NAME with the alias camber::NAME. A folder
# within it that needs more than the rest may be a library of its own, camber_NAME_FOLDER.
function(camber_add_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(camber_${name} STATIC ${ARG_SOURCES})
  add_library(camber::${name} ALIAS camber_${name})
  set_target_properties(camber_${name} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(camber_${name} PUBLIC cxx_std_17)
  target_include_directories(
    camber_${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/lib>
                          $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(camber_${name} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
  set_property(GLOBAL APPEND PROPERTY CAMBER_MODULES camber_${name})
endfunction()

# camber_add_test(MODULE SOURCES ... [LIBRARIES targets...] [LABELS ...] [TOGETHER suites...]
#                 [FIRST suites...])
# One GoogleTest program a module, test_MODULE; every case becomes a ctest with the label (unit), but
# the suites of TOGETHER one ctest each (A:B is one of both, named A): those that share what is costly
# to set up or whose cases are shorter than the program's start. None of their cases may skip itself.
# The suites of FIRST, which take longest, are among TOGETHER's and started before others.
function(camber_add_test module)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBRARIES;LABELS;TOGETHER;FIRST" ${ARGN})
  add_executable(test_${module} ${ARG_SOURCES})
  target_link_libraries(test_${module} PRIVATE camber_test_support ${ARG_LIBRARIES})
  if(NOT ARG_LABELS)
    set(ARG_LABELS unit)
  endif()
  set(filter "")
  foreach(group IN LISTS ARG_TOGETHER)
    string(REGEX REPLACE ":.*" "" suite "${group}")
    string(REPLACE ":" ".*:" group "${group}")
    add_test(NAME ${module}.${suite} COMMAND test_${module} --gtest_filter=${group}.*)
    set_tests_properties(${module}.${suite} PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT 900)
    string(APPEND filter ":${group}.*")
  endforeach()
  foreach(suite IN LISTS ARG_FIRST)
    set_tests_properties(${module}.${suite} PROPERTIES COST 20)
  endforeach()
  if(filter)
    string(REGEX REPLACE "^:" "-" filter "${filter}")
    set(filter TEST_FILTER "${filter}")
  endif()
  gtest_discover_tests(test_${module} DISCOVERY_TIMEOUT 120 ${filter}
                       TEST_PREFIX "${module}." PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT 900)
endfunction()
