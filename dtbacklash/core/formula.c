/* Formulas of users, evaluated without a compiler. */
#include "core.h"

/* What an operation of one number makes of it. */
static double apply_unary(int64_t operation, double x)
{
    switch (operation) {
    case OP_NEGATIVE: return -x;
    case OP_SQUARE: return x * x;
    case OP_ABS: return fabs(x);
    case OP_SIGN: return isnan(x) ? x : (double)sign_of(x);
    case OP_SIN: return sin(x);
    case OP_COS: return cos(x);
    case OP_TAN: return tan(x);
    case OP_ATAN: return atan(x);
    case OP_EXP: return exp(x);
    case OP_LOG: return log(x);
    case OP_SQRT: return sqrt(x);
    default: return tanh(x);
    }
}

/* What an operation of two numbers makes of them; no number stays one in the least and the largest. */
static double apply_binary(int64_t operation, double x, double y)
{
    switch (operation) {
    case OP_ADD: return x + y;
    case OP_SUBTRACT: return x - y;
    case OP_MULTIPLY: return x * y;
    case OP_DIVIDE: return x / y;
    case OP_POWER: return pow(x, y);
    case OP_MIN: return isnan(x) || x < y ? x : y;
    default: return isnan(x) || x > y ? x : y;
    }
}

/* Value of a formula at states `at` with parameters p. Its stack never holds more than STACK numbers. */
double dtb_formula(const Formula *formula, const double *at, const double *p)
{
    double stack[STACK];
    int64_t top = -1;

    for (int64_t k = 0; k < formula->length; k++) {
        int64_t operation = formula->operation[k], number = formula->number[k];
        switch (operation) {
        case OP_CONSTANT: stack[++top] = formula->constant[number]; break;
        case OP_STATE: stack[++top] = at[number]; break;
        case OP_PARAMETER: stack[++top] = p[number]; break;
        case OP_ADD:
        case OP_SUBTRACT:
        case OP_MULTIPLY:
        case OP_DIVIDE:
        case OP_POWER:
        case OP_MIN:
        case OP_MAX:
            top--;
            stack[top] = apply_binary(operation, stack[top], stack[top + 1]);
            break;
        default: stack[top] = apply_unary(operation, stack[top]);
        }
    }
    return stack[0];
}
