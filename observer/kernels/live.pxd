cpdef void walk_on(Rows rows, Py_ssize_t count, Expected plan, Memory memory, Frames frames) noexcept nogil
cpdef void drive_on(ColumnsRead read, DriveDesk desk, double begin_s, double last_s) noexcept nogil
cpdef void average_on(NutTable nut, NutDesk desk, const double[::1] dt_s, const double[::1] sample_s, const double[::1] sample_m, const Py_ssize_t[::1] offset, const double[::1] driven_m_s) noexcept nogil
