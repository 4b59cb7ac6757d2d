// HID report descriptors from what WebHID tells about a device: browsers parse the device's own descriptor and do not
// pass it on, so its input items are written again. The server reads the layout of reports from there.
// Device Class Definition for HID 1.11, section 6.2.2.

/** Item of an input report, as `HIDReportItem`; usages have their page in the upper 16 bits. */
export interface ReportItem {
  isArray?: boolean;
  isConstant?: boolean;
  isRange?: boolean;
  usages?: readonly number[];
  usageMinimum?: number;
  usageMaximum?: number;
  reportSize?: number;
  reportCount?: number;
  logicalMinimum?: number;
  logicalMaximum?: number;
}

/** Top-level collection of a device, as `HIDCollectionInfo`. */
export interface ReportCollection {
  usagePage?: number;
  usage?: number;
  inputReports?: readonly { reportId?: number; items?: readonly ReportItem[] }[];
}

/** Usage page and usage of a multi-axis controller, such as a SpaceMouse. */
export const MULTI_AXIS_CONTROLLER = { usagePage: 0x01, usage: 0x08 };

/** Short item with four bytes of data; `tag` is the item's prefix without its size. */
const item = (tag: number, value: number): number[] => [tag | 3, value & 0xff, (value >> 8) & 0xff, (value >> 16) & 0xff, (value >> 24) & 0xff];

/** Report descriptor with the input items of a device, in their order. */
export function descriptor(collections: readonly ReportCollection[]): Uint8Array {
  const bytes: number[] = [];
  for (const { inputReports = [] } of collections) {
    for (const { reportId = 0, items = [] } of inputReports) {
      if (reportId > 0) bytes.push(...item(0x84, reportId));
      for (const one of items) {
        bytes.push(...item(0x14, one.logicalMinimum ?? 0), ...item(0x24, one.logicalMaximum ?? 0));
        bytes.push(...item(0x74, one.reportSize ?? 0), ...item(0x94, one.reportCount ?? 0));
        if (one.isRange) bytes.push(...item(0x18, one.usageMinimum ?? 0), ...item(0x28, one.usageMaximum ?? 0));
        else for (const usage of one.usages ?? []) bytes.push(...item(0x08, usage));
        bytes.push(...item(0x80, (one.isConstant ? 1 : 0) | (one.isArray ? 0 : 2)));
      }
    }
  }
  return Uint8Array.from(bytes);
}

/** Input report as the device sent it: the id comes first if the device uses ids. */
export function report(reportId: number, data: DataView): Uint8Array {
  const body = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  return reportId > 0 ? Uint8Array.from([reportId, ...body]) : Uint8Array.from(body);
}

export const hexadecimal = (bytes: Uint8Array): string => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
