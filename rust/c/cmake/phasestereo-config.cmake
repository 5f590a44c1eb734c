# find_package(phasestereo) makes the target phasestereo::phasestereo. This file is in share/cmake/phasestereo.
get_filename_component(_phasestereo_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

find_path(phasestereo_INCLUDE_DIR phasestereo.h
  PATHS "${_phasestereo_prefix}/include" NO_DEFAULT_PATH)
find_library(phasestereo_LIBRARY phasestereo
  PATHS "${_phasestereo_prefix}" PATH_SUFFIXES lib "lib/${CMAKE_LIBRARY_ARCHITECTURE}" lib64 bin NO_DEFAULT_PATH)

include(FindPackageHandleStandardArgs)
set(phasestereo_CONFIG "${CMAKE_CURRENT_LIST_FILE}")
find_package_handle_standard_args(phasestereo CONFIG_MODE REQUIRED_VARS phasestereo_LIBRARY phasestereo_INCLUDE_DIR)

if(phasestereo_FOUND AND NOT TARGET phasestereo::phasestereo)
  add_library(phasestereo::phasestereo UNKNOWN IMPORTED)
  set_target_properties(phasestereo::phasestereo PROPERTIES
    IMPORTED_LOCATION "${phasestereo_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${phasestereo_INCLUDE_DIR}")
endif()
