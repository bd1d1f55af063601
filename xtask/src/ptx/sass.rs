//! Where spilled registers are stored and loaded, in the text of `nvdisasm -c`.

use std::collections::HashMap;

/// The instructions that store registers to the stack and load them.
const SPILLS: [&str; 2] = ["STL", "LDL"];

/// Number of instructions within a loop that access the stack. A loop reaches from a label to a later branch to it.
pub(super) fn spills_in_loops(text: &str) -> usize {
    let mut labels = HashMap::new();
    let mut loops = Vec::new();
    let mut spills = Vec::new();
    let mut index = 0;
    for line in text.lines().map(str::trim) {
        if let Some(label) = line.strip_suffix(':') {
            labels.insert(label, index);
        } else if let Some(instruction) = instruction_of(line) {
            let label = instruction.split('`').nth(1).and_then(|rest| rest.strip_prefix('(')?.split(')').next());
            let is_branch = instruction.contains("BRA");
            loops.extend(label.filter(|_| is_branch).and_then(|label| labels.get(label)).map(|&first| (first, index)));
            let is_spill =
                instruction.split_whitespace().any(|word| SPILLS.contains(&word.split('.').next().unwrap_or(word)));
            spills.extend(is_spill.then_some(index));
            index += 1;
        }
    }
    spills.iter().filter(|&&at| loops.iter().any(|&(first, last)| (first..=last).contains(&at))).count()
}

/// The instruction of a line such as `/*0010*/  STL [R1], R4 ;`.
fn instruction_of(line: &str) -> Option<&str> {
    let (address, rest) = line.strip_prefix("/*")?.split_once("*/")?;
    let is_address = !address.is_empty() && address.chars().all(|digit| digit.is_ascii_hexdigit());
    rest.split(';').next().filter(|_| is_address && rest.contains(';')).map(str::trim)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_accesses_between_a_label_and_a_branch_back_count() {
        let text = "\
.text.blend:
        /*0000*/                   STL.64 [R1], R4 ;
.L_x_1:
        /*0010*/                   FADD R0, R0, R1 ;
        /*0020*/               @P0 LDL R2, [R1+0x4] ;
        /*0030*/              @!P0 BRA `(.L_x_1) ;
        /*0040*/                   BRA `(.L_x_2) ;
.L_x_2:
        /*0050*/                   LDL.LU R4, [R1] ;
";
        assert_eq!(spills_in_loops(text), 1);
        assert_eq!(spills_in_loops(&text.replace("@P0 LDL R2", "@P0 LDS R2")), 0);
    }
}
